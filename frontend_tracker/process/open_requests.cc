#include "process/open_requests.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <utility>

namespace portolan {

void OpenRequests::Send(std::vector<Request> requests) {
  for (Request& request : requests) {
    request.id = ids_.Next();
    request.sender = sender_;
    spdlog::debug("request {} map {} other {} {}", request.kind, ToString(request.map), ToString(request.other),
                  request.argument);
    writer_->Write(request);
    const RequestId id = request.id;
    open_[id] = {std::move(request), Clock::now()};
  }
}

void OpenRequests::SendAgain(Clock::duration patience) {
  const auto now = Clock::now();
  for (auto next = open_.begin(); next != open_.end();) {
    Open& open = next->second;
    const bool is_late = now - open.sent >= patience;
    if (is_late && open.request.kind == "locate") {
      next = open_.erase(next);
      continue;
    }
    if (is_late) {
      writer_->Write(open.request);
      open.sent = now;
    }
    ++next;
  }
}

std::optional<Request> OpenRequests::Close(const Reply& reply) {
  const auto open = open_.find(reply.id);
  if (open == open_.end()) return std::nullopt;
  Request request = std::move(open->second.request);
  open_.erase(open);
  if (!reply.ok) {
    // A tracker goes on whatever the atlas_server says; that a place is not known is no news.
    const auto level = request.kind == "new_map" ? spdlog::level::warn : spdlog::level::debug;
    spdlog::log(level, "request {} refused: {}", request.kind, reply.reason);
  }
  return request;
}

bool OpenRequests::HasAny(const std::string& kind) const {
  return std::any_of(open_.begin(), open_.end(), [&](const auto& entry) { return entry.second.request.kind == kind; });
}

}  // namespace portolan
