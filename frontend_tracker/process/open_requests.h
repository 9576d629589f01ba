#pragma once

#include <chrono>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "map/protocol.h"
#include "transport/bus.h"

namespace portolan {

/// The tracker's requests to the atlas_server that have not been answered: it may be down, and come again.
class OpenRequests {
 public:
  using Clock = std::chrono::steady_clock;

  OpenRequests(ProcessId sender, RobotId robot, uint32_t session, Bus* bus)
      : sender_(sender), ids_(robot, session), writer_(bus->CreateWriter<Request>()) {}

  /// Gives the requests their ids, and sends them.
  void Send(std::vector<Request> requests);
  /// Sends those again that have waited for so long. Where the camera was is no question any more by then: "locate" is
  /// forgotten.
  void SendAgain(Clock::duration patience);
  /// @return the request that the reply answers, which is closed with it; none if it is somebody else's.
  std::optional<Request> Close(const Reply& reply);

  bool empty() const { return open_.empty(); }
  bool HasAny(const std::string& kind) const;
  int MatchedReaders() const { return writer_->MatchedReaders(); }

 private:
  struct Open {
    Request request;
    Clock::time_point sent;
  };
  ProcessId sender_;
  IdMinter<RequestId> ids_;
  std::unique_ptr<Writer<Request>> writer_;
  std::map<RequestId, Open> open_;
};

}  // namespace portolan
