#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "base/result.h"
#include "dataset/compressed_image.h"
#include "dataset/image_source.h"
#include "map/map_delta.h"
#include "map/protocol.h"

namespace portolan {

enum class DdsVendor { kFastDds, kCycloneDds };
Result<DdsVendor> ParseDdsVendor(const std::string& name);  ///< "fastdds" or "cyclonedds"
std::string ToString(DdsVendor vendor);

struct BusOptions {
  DdsVendor vendor = DdsVendor::kFastDds;
  int domain = 0;                     ///< 0 to 230: deployments are kept apart by it
  std::string partition = "robot_0";  ///< robots are kept apart by it
  std::vector<std::string> peers;     ///< addresses of other hosts where multicast does not reach; empty: multicast
  bool small_datagrams = false;       ///< datagrams under one MTU: for lossy links (design/dds.md)
  std::string image_topic =
      "rt/image";  ///< as ROS 2 names it on the wire; compressed images on it + "/compressed"; in no partition
  /// Folder of the credentials with which the participant joins (credentials.h); empty: DDS Security is off.
  std::string credentials_folder;
  /// Ranges and characters of each field, and that the credentials hold now; the message names the key.
  Status Check() const;
};

/// Counters of one topic in this process.
struct TopicCounters {
  uint64_t sent = 0, sent_bytes = 0;  ///< bytes of serialised samples
  uint64_t received = 0, received_bytes = 0;
  uint64_t malformed = 0;  ///< refused by deserialisation or validation: counted, named in the log, dropped
  uint64_t send_failures = 0;
  uint64_t lost = 0;  ///< reported lost or rejected by DDS
};

/// Publishes samples of one topic. Thread-safe.
template <class T>
class Writer {
 public:
  virtual ~Writer() = default;
  /// False (and counted) when DDS did not take it.
  virtual bool Write(const T& message) = 0;
  virtual int MatchedReaders() const = 0;
  /// Says that the writer's thread is alive, without a message. A writer that already counts as dead comes back with
  /// its next Write: Cyclone DDS readers don't take an assertion for it.
  virtual void AssertLiveliness() = 0;
  /// Waits until every matched reader has acknowledged everything, or the time is over.
  virtual bool WaitForAcknowledgments(double seconds) = 0;
};

/// Delivers samples of one topic to its handler until destroyed. The handler runs on a transport thread: it converts,
/// enqueues, returns.
class Reader {
 public:
  virtual ~Reader() = default;
  virtual int MatchedWriters() const = 0;
  /// Writers whose liveliness holds now.
  virtual int AliveWriters() const = 0;
};

namespace internal {
struct BusCore;
}

/// A process's access to DDS. Message types are the domain types; which wire type, topic name and QoS each has stands
/// in topics.h, and conversion and validation in messages/. Readers wait on WaitSets; nothing polls. Destroy writers
/// and readers before the bus.
class Bus {
 public:
  virtual ~Bus() = default;

  /// T: KeyFrameMessage, MapDeltaChunk, SnapshotRequest, MapCorrection, Command, Request, Reply, TrackerState,
  /// MapperState, FollowerState, ProcessStatus, or Image (topic image; its readers get raw and compressed images,
  /// numbered as they come; CompressedImage is for writing alone). From one thread. That DDS makes no endpoint (out of
  /// memory or handles) is a check failure. Handlers of one reader are called one at a time.
  template <class T>
  std::unique_ptr<Writer<T>> CreateWriter();
  /// @param on_liveliness_changed called on a transport thread with AliveWriters() when it changes; for topics with
  /// liveliness (process_status).
  template <class T>
  std::unique_ptr<Reader> CreateReader(std::function<void(T)> handler,
                                       std::function<void(int alive_writers)> on_liveliness_changed = nullptr);

  /// By topic name.
  virtual std::map<std::string, TopicCounters> Counters() const = 0;
  virtual DdsVendor vendor() const = 0;

 private:
  virtual internal::BusCore& core() = 0;
};

/// Joins the domain. Fails when the participant can't be made (with the vendor's reason where it gives one).
Result<std::unique_ptr<Bus>> MakeBus(const BusOptions& options);

/// Kernel limits too small for the buffers that the transport asks for, as warnings which name the sysctl and the value
/// to set; empty if fine.
std::vector<std::string> CheckKernelBuffers();

}  // namespace portolan
