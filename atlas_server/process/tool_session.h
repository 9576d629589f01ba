#pragma once

#include <algorithm>
#include <chrono>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "base/bounded_queue.h"
#include "base/ids.h"
#include "map/map.h"
#include "map/map_replica.h"
#include "process/process_setup.h"
#include "tool/map_list.h"
#include "tool/status_book.h"
#include "transport/bus.h"

namespace portolan {

/// A tool's part in a deployment, for as long as one command takes: asks the atlas_server, listens to what processes
/// tell of themselves, fetches maps from whoever owns them. One thread; what comes is handled while it waits.
class ToolSession {
 public:
  /// @param timeout_s how long it waits for an answer.
  ToolSession(Bus* bus, RobotId robot, double timeout_s);

  /// Repeats the request each second until it is answered. Fails with the atlas_server's reason (exit_code() is then
  /// kExitRefused), or when none answers (kExitUnreachable).
  Result<Reply> Ask(const std::string& kind, MapId map = MapId(), MapId other = MapId(),
                    const std::string& argument = "");
  /// Waits for an answer for so long at least from now on: what is asked takes its time.
  void BePatient(double timeout_s) { timeout_s_ = std::max(timeout_s_, timeout_s); }
  Result<MapList> ListMaps();
  Result<DescribedGraph> FetchGraph();

  /// Hears the processes until `done`, asked at each status, or until the time is over. @return whether it was done.
  bool Listen(double timeout_s, const std::function<bool()>& done);
  const StatusBook& book() const { return book_; }

  /// Follows a map as a replica until it is as far as the list says: its owner, or the atlas_server, sends it whole.
  /// Fails when nothing comes any more (kExitUnreachable).
  Result<Map> FetchMap(const MapList::Entry& entry);

  /// Notes the exit code that a failure leads to. @return the failure.
  Error Fail(ExitCode code, std::string message);
  /// Of the last failure noted; kExitFailure if none was.
  int exit_code() const { return exit_code_; }
  double timeout_s() const { return timeout_s_; }
  static double Now() { return std::chrono::duration<double>(Clock::now().time_since_epoch()).count(); }

 private:
  using Clock = std::chrono::steady_clock;
  using Inbox = BoundedQueue<std::function<void()>>;

  /// Handles what has come, waiting for it until `until_s` at most. @return whether something came.
  bool HandleNext(double until_s);

  Bus* bus_;
  ProcessId self_;
  double timeout_s_;
  int exit_code_ = kExitFailure;
  StatusBook book_;
  Inbox inbox_;
  IdMinter<RequestId> ids_;
  std::optional<Reply> reply_;  // to the request under way
  RequestId asked_;
  std::unique_ptr<Writer<Request>> request_writer_;
  std::unique_ptr<Reader> reply_reader_, status_reader_;  // last: stop before what they write to goes
};

}  // namespace portolan
