#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/result.h"
#include "transport/bus.h"
#include "transport/credentials.h"
#include "transport/topic_qos.h"

namespace portolan {

// What a DDS vendor has to provide: endpoints that carry serialised samples. Conversion, validation and counting stand
// above it, in bus.cc, once for both vendors.

/// A sample as it travels: 4 bytes of encapsulation header (CDR_BE or CDR_LE), then plain CDR.
using SampleBytes = std::vector<uint8_t>;

struct RawTopic {
  std::string name;
  std::string type;    ///< as both vendors announce it
  bool keyed = false;  ///< the key is the first member, an unsigned long long
  TopicQos qos;
};

class RawWriter {
 public:
  virtual ~RawWriter() = default;
  /// An error with the vendor's reason when DDS did not take it. Thread-safe.
  virtual Status Write(SampleBytes sample) = 0;
  virtual int MatchedReaders() const = 0;
  virtual void AssertLiveliness() = 0;
  virtual bool WaitForAcknowledgments(double seconds) = 0;
};

/// What a reader's thread calls, one at a time.
struct RawReaderEvents {
  std::function<void(const uint8_t* data, size_t size)> on_sample;
  std::function<void(int alive_writers)> on_liveliness_changed;  ///< may be null
  std::function<void(uint64_t count)> on_lost;                   ///< samples lost or rejected since the last call
};

class RawBus {
 public:
  virtual ~RawBus() = default;
  virtual Result<std::unique_ptr<RawWriter>> CreateWriter(const RawTopic& topic) = 0;
  virtual Result<std::unique_ptr<Reader>> CreateReader(const RawTopic& topic, RawReaderEvents events) = 0;
};

/// What of the options had to be looked up.
struct BusSurroundings {
  std::vector<std::string> peers;          ///< numeric IPv4 addresses in place of options.peers
  std::optional<Credentials> credentials;  ///< in place of options.credentials_folder; none: DDS Security is off
};
Result<std::unique_ptr<RawBus>> MakeFastDdsBus(const BusOptions& options, const BusSurroundings& surroundings);
Result<std::unique_ptr<RawBus>> MakeCycloneDdsBus(const BusOptions& options, const BusSurroundings& surroundings);

/// Checks the options, resolves the peers, reads the credentials and joins with the vendor asked for.
Result<std::unique_ptr<RawBus>> MakeRawBus(const BusOptions& options);

/// Key of a serialised sample of a keyed topic, big-endian as in a key hash; zeros for a sample too short to have one.
struct SampleKey {
  static constexpr size_t kBytes = 8;
  uint8_t bytes[kBytes] = {};
};
SampleKey KeyOfSample(const uint8_t* data, size_t size);

/// Lease of a participant: a link may be cut for less than this without loss (design/dds.md). Equal on both vendors.
constexpr int kParticipantLeaseS = 60;
/// Participants announce themselves so often, so that one whose first announcements were lost is found all the same.
constexpr int kAnnouncementPeriodS = 5;
/// Socket buffers that both vendors ask the kernel for.
constexpr int kSocketBufferBytes = 4 << 20;
/// Participants of one host that can be found through its address alone, where there is no multicast.
constexpr int kMaxParticipantsPerHost = 20;

}  // namespace portolan
