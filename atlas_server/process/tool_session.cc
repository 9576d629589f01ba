#include "process/tool_session.h"

#include <algorithm>
#include <utility>
#include <vector>

namespace portolan {
namespace {

constexpr size_t kInboxCapacity = 4096;  // a map's keyframes come faster than they are taken in
constexpr double kRepeatS = 1.0;         // between two tries of a request
constexpr double kMatchPauseS = 0.02;    // between two looks whether the other side was discovered
constexpr double kStalledS = 1.5;        // without a piece of a snapshot: what was lost on the way is asked for again

}  // namespace

ToolSession::ToolSession(Bus* bus, RobotId robot, double timeout_s)
    : bus_(bus),
      self_(robot, DrawSession(), 1),
      timeout_s_(timeout_s),
      inbox_(kInboxCapacity, Overflow::kDropNewest),
      ids_(robot, self_.session()),
      request_writer_(bus->CreateWriter<Request>()),
      reply_reader_(bus->CreateReader<Reply>([this](Reply reply) {
        inbox_.Push([this, reply = std::move(reply)] {
          if (reply.id == asked_) reply_ = reply;
        });
      })) {}

Error ToolSession::Fail(ExitCode code, std::string message) {
  exit_code_ = code;
  return Error{std::move(message)};
}

bool ToolSession::HandleNext(double until_s) {
  const auto deadline =
      Clock::time_point(std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(until_s)));
  auto event = inbox_.PopUntil(deadline);
  if (event) (*event)();
  return event.has_value();
}

Result<Reply> ToolSession::Ask(const std::string& kind, MapId map, MapId other, const std::string& argument) {
  Request request;
  request.id = asked_ = ids_.Next();
  request.sender = self_;
  request.kind = kind;
  request.map = map;
  request.other = other;
  request.argument = argument;
  reply_.reset();
  const double deadline_s = Now() + timeout_s_;
  double next_try_s = Now();
  while (!reply_ && Now() < deadline_s) {
    // Both ways must stand: a request that is heard before its answer could be is answered in vain.
    const bool is_matched = request_writer_->MatchedReaders() > 0 && reply_reader_->MatchedWriters() > 0;
    if (is_matched && Now() >= next_try_s) {
      request_writer_->Write(request);
      next_try_s = Now() + kRepeatS;
    }
    HandleNext(std::min(is_matched ? next_try_s : Now() + kMatchPauseS, deadline_s));
  }
  if (!reply_)
    return Fail(kExitUnreachable,
                "no atlas_server answered within " + std::to_string(static_cast<int>(timeout_s_)) + " s");
  if (!reply_->ok) return Fail(kExitRefused, reply_->reason);
  return *reply_;
}

Result<MapList> ToolSession::ListMaps() {
  const Result<Reply> reply = Ask("list_maps");
  if (!reply) return reply.error();
  Result<MapList> list = ParseMapList(reply->text);
  if (!list) return Fail(kExitFailure, list.error().message);
  return list;
}

Result<DescribedGraph> ToolSession::FetchGraph() {
  const Result<Reply> reply = Ask("map_graph");
  if (!reply) return reply.error();
  Result<DescribedGraph> graph = ParseMapGraph(reply->text);
  if (!graph) return Fail(kExitFailure, graph.error().message);
  return graph;
}

bool ToolSession::Listen(double timeout_s, const std::function<bool()>& done) {
  if (!status_reader_) {
    status_reader_ = bus_->CreateReader<ProcessStatus>([this](ProcessStatus status) {
      inbox_.Push([this, status = std::move(status)] { book_.Hear(status, Now()); });
    });
  }
  const double deadline_s = Now() + timeout_s;
  while (!done() && Now() < deadline_s) HandleNext(deadline_s);
  return done();
}

Result<Map> ToolSession::FetchMap(const MapList::Entry& entry) {
  if (entry.revision == 0) return Fail(kExitRefused, "map " + ToString(entry.map) + " holds nothing yet");
  struct Copy {
    MapReplica replica;
    DeltaAssembler assembler;
    size_t copies = 0;  // of keyframes, sent with snapshots
  };
  // Events that are left over have it too.
  const auto copy = std::make_shared<Copy>(Copy{MapReplica(entry.map), DeltaAssembler()});
  MapReplica& replica = copy->replica;
  const auto keyframe_reader = bus_->CreateReader<KeyFrameMessage>([this, copy](KeyFrameMessage message) {
    if (message.map != copy->replica.map().id()) return;
    const bool is_copy = message.kind == KeyFrameKind::kCopy;
    auto data = std::make_shared<const KeyFrameData>(std::move(message.data));
    inbox_.Push([copy, is_copy, data = std::move(data)] {
      if (is_copy && copy->replica.FindKeyFrameData(data->id) == nullptr) ++copy->copies;
      copy->replica.AddKeyFrameData(data);
    });
  });
  const auto delta_reader = bus_->CreateReader<MapDeltaChunk>([this, copy](MapDeltaChunk chunk) {
    if (chunk.part.map != copy->replica.map().id()) return;
    inbox_.Push([copy, chunk = std::move(chunk)] {
      for (MapDelta& delta : copy->assembler.Add(chunk)) copy->replica.AddDelta(std::move(delta));
    });
  });
  const auto request_writer = bus_->CreateWriter<SnapshotRequest>();
  double last_piece_s = Now(), next_request_s = Now();
  size_t most_copies = 0, most_pending = 0;
  for (;;) {
    replica.ApplyPending();
    const Map& map = replica.map();
    if (std::pair(map.epoch(), map.revision()) >= std::pair(entry.state_epoch, entry.revision) && map.revision() > 0)
      return map;
    // A piece of the snapshot. The news of a map that grows are none: they come also when the request reached somebody
    // else than its owner, who is discovered later, and is never answered. Nor is what was sent before: who has all and
    // can't apply it is sent the same again and again.
    const size_t pending = copy->assembler.pending_bytes();
    if (copy->copies > most_copies || pending > most_pending) {
      last_piece_s = Now();
      next_request_s = std::max(next_request_s, last_piece_s + kStalledS);
    }
    most_copies = copy->copies;
    most_pending = std::max(most_pending, pending);
    if (Now() - last_piece_s > timeout_s_) {
      return Fail(kExitUnreachable, "map " + ToString(entry.map) + ": its owner does not send it" +
                                        (replica.last_problem().empty() ? "" : " whole: " + replica.last_problem()));
    }
    const bool is_matched = request_writer->MatchedReaders() > 0 && keyframe_reader->MatchedWriters() > 0 &&
                            delta_reader->MatchedWriters() > 0;
    if (is_matched && Now() >= next_request_s) {
      request_writer->Write(replica.MakeRequest(self_));
      next_request_s = Now() + kStalledS;
    }
    HandleNext(Now() + (is_matched ? 0.2 : kMatchPauseS));
  }
}

}  // namespace portolan
