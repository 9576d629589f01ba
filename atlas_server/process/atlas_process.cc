#include "process/atlas_process.h"

#include <set>
#include <utility>

#include "base/hash.h"
#include "messages/limits.h"
#include "process/process_report.h"

namespace portolan {
namespace {

constexpr double kStatusPeriodS = 1.0;
constexpr double kTickPeriodS = 0.15;  // well within the liveliness lease of 500 ms

}  // namespace

AtlasProcess::AtlasProcess(const ProcessSetup& setup, const AtlasOptions& options, uint64_t vocabulary_hash,
                           MapStore* store, Bus* bus, const std::string& priority, ProcessLoop* loop)
    : setup_(setup),
      vocabulary_hash_(vocabulary_hash),
      store_(store),
      bus_(bus),
      priority_(priority),
      loop_(loop),
      status_(bus, setup, priority),
      command_writer_(bus->CreateWriter<Command>()),
      reply_writer_(bus->CreateWriter<Reply>()),
      keyframe_writer_(bus->CreateWriter<KeyFrameMessage>()),
      delta_writer_(bus->CreateWriter<MapDeltaChunk>()),
      snapshot_writer_(bus->CreateWriter<SnapshotRequest>()),
      atlas_(setup.process, Now()) {
  if (store_ != nullptr) saver_.emplace(store_, options.store_interval_s);
}

AtlasProcess::~AtlasProcess() {
  readers_.clear();
}

Status AtlasProcess::LoadStore() {
  if (store_ == nullptr) return Ok{};
  Result<MapStore::Content> content = store_->Load();
  if (!content) return content.error();
  for (const std::string& problem : content->problems) spdlog::error("{}", problem);
  atlas_.Restore(content->ownerships);
  for (MapStore::StoredMap& stored : content->maps) {
    const MapDelta& snapshot = stored.snapshot;
    for (const KeyFrameData& data : stored.keyframes)
      replicas_.AddKeyFrameData(snapshot.map, WithoutAppearance(data));
    atlas_.OnEpoch(snapshot.map, snapshot.epoch);
    replicas_.AddDelta(std::move(stored.snapshot));
    status_.AssertLiveliness();
  }
  replicas_.ApplyPending();
  for (const auto& [id, replica] : replicas_.replicas()) {
    if (replica.NeedsSnapshot()) {
      spdlog::error("atlas store '{}': map {} is no valid map and left out: {}", store_->path(), ToString(id),
                    replica.last_problem());
    } else {
      saver_->Restore(id, replica.map().epoch(), replica.map().revision());
    }
  }
  const Totals totals = CountTotals();
  spdlog::info("atlas store '{}': {} maps, {} keyframes, {} points", store_->path(), totals.maps, totals.keyframes,
               totals.points);
  return Ok{};
}

void AtlasProcess::ConnectReaders() {
  const auto post = [this](auto handle) {
    return [this, handle](auto message) {
      loop_->Post([this, handle, message = std::move(message)] { (this->*handle)(message); });
    };
  };
  readers_.push_back(bus_->CreateReader<ProcessStatus>(post(&AtlasProcess::OnStatus)));
  readers_.push_back(bus_->CreateReader<MapperState>(post(&AtlasProcess::OnMapperState)));
  readers_.push_back(bus_->CreateReader<KeyFrameMessage>(post(&AtlasProcess::OnKeyFrame)));
  readers_.push_back(bus_->CreateReader<MapDeltaChunk>(post(&AtlasProcess::OnDeltaChunk)));
  readers_.push_back(bus_->CreateReader<SnapshotRequest>(post(&AtlasProcess::OnSnapshotRequest)));
  readers_.push_back(bus_->CreateReader<Request>(post(&AtlasProcess::OnRequest)));
}

int AtlasProcess::Run() {
  ConnectReaders();
  loop_->AddTimer(kStatusPeriodS, [this] { OnStatusTimer(); });
  loop_->AddTimer(kTickPeriodS, [this] { OnTick(); });
  OnStatusTimer();
  loop_->Run();
  readers_.clear();
  return Finish();
}

void AtlasProcess::OnStatus(const ProcessStatus& status) {
  if (status.process == setup_.process) return;
  atlas_.OnStatus(status, Now());
  if (status.map.IsValid()) replicas_.Announce(status.map, status.epoch, status.revision);
  PublishDecisions();
}

void AtlasProcess::OnMapperState(const MapperState& state) {
  atlas_.OnSignOfLife(state.process, Now());
  if (state.map.IsValid()) replicas_.Announce(state.map, state.epoch, state.revision);
}

void AtlasProcess::OnKeyFrame(const KeyFrameMessage& message) {
  if (message.vocabulary_hash != vocabulary_hash_) {
    if (foreign_vocabulary_++ == 0) {
      spdlog::error("keyframes made with another vocabulary ({:016x}, here {:016x}) are passed over",
                    message.vocabulary_hash, vocabulary_hash_);
    }
    return;
  }
  if (!message.map.IsValid()) return;
  // As it came, or less: nothing here looks for places or features.
  const bool stored = store_ != nullptr && store_->HasKeyFrame(message.data.id);
  replicas_.AddKeyFrameData(
      message.map, stored ? WithoutAppearance(message.data) : std::make_shared<const KeyFrameData>(message.data));
  ApplyPending();
}

void AtlasProcess::OnDeltaChunk(const MapDeltaChunk& chunk) {
  atlas_.OnEpoch(chunk.part.map, chunk.part.epoch);
  replicas_.AddChunk(chunk);
  ApplyPending();
}

void AtlasProcess::ApplyPending() {
  const Stopwatch stopwatch;
  const std::vector<MapDelta> applied = replicas_.ApplyPending();
  if (applied.empty()) return;
  last_map_ = applied.back().map;
  times_.Add("apply", stopwatch.Milliseconds());
}

void AtlasProcess::OnRequest(const Request& request) {
  if (request.kind == "list_maps" || request.kind == "save") {
    Reply reply = request.kind == "save" ? SaveOnRequest() : ListMaps();
    reply.id = request.id;
    reply.sender = setup_.process;
    reply_writer_->Write(reply);
    return;
  }
  atlas_.OnRequest(request, Now());
  PublishDecisions();
}

/// What was granted is on the disk before anybody hears of it: an atlas_server that comes after this one goes on above
/// these epochs. A store that fails holds nobody up: epochs are learned from living mappers too.
void AtlasProcess::PublishDecisions() {
  for (const Atlas::Ownership& granted : atlas_.TakeGrants()) {
    spdlog::info("map {} of robot {}: owner {}, epoch {}", ToString(granted.map), granted.robot,
                 ToString(granted.owner), granted.epoch);
    ++grants_;
    if (store_ == nullptr) continue;
    if (Status saved = store_->SaveOwnership(granted); !saved) NoteStoreFailure(saved.error());
  }
  for (const Command& command : atlas_.TakeCommands()) command_writer_->Write(command);
  for (const Reply& reply : atlas_.TakeReplies()) {
    if (!reply.ok) spdlog::warn("refused: {}", reply.reason);
    reply_writer_->Write(reply);
  }
}

/// Stands in for owners that don't live, and serves a new owner that asks for the map it was granted.
void AtlasProcess::OnSnapshotRequest(const SnapshotRequest& request) {
  if (request.asker == setup_.process) return;
  const auto ownership = atlas_.maps().find(request.map);
  if (ownership == atlas_.maps().end()) return;
  const auto& [map, robot, epoch, owner] = ownership->second;
  if (owner.IsValid() && owner != request.asker && atlas_.IsAlive(owner, Now())) return;
  const auto replica = replicas_.replicas().find(map);
  if (replica != replicas_.replicas().end() && replica->second.map().revision() > 0) {
    SendSnapshot(replica->second.map(), request.have_keyframes);
  } else if (owner == request.asker && replicas_.IsEmpty(map)) {
    SendSnapshot(Map(map, epoch - 1), {});  // its last owner had not begun it
  }
}

void AtlasProcess::SendSnapshot(const Map& map, const std::vector<KeyFrameId>& have_list) {
  const Stopwatch stopwatch;
  const std::set<KeyFrameId> have(have_list.begin(), have_list.end());
  for (const auto& [id, keyframe] : map.keyframes()) {
    if (have.count(id) == 1) continue;
    Result<KeyFrameData> data = WholeData(*keyframe.data);
    if (!data) {
      ++store_failures_;
      spdlog::error("map {} can't be sent to its owner: {}", ToString(map.id()), data.error().message);
      return;
    }
    KeyFrameMessage copy;
    copy.kind = KeyFrameKind::kCopy;
    copy.data = std::move(*data);
    copy.map = map.id();
    copy.vocabulary_hash = vocabulary_hash_;
    keyframe_writer_->Write(copy);
    status_.AssertLiveliness();
  }
  for (const MapDeltaChunk& chunk : SplitDelta(map.Snapshot(), kDeltaChunkElements)) delta_writer_->Write(chunk);
  ++snapshots_sent_;
  times_.Add("snapshot", stopwatch.Milliseconds());
  spdlog::info("sent map {} at revision {} for its owner", ToString(map.id()), map.revision());
}

Result<KeyFrameData> AtlasProcess::WholeData(const KeyFrameData& data) {
  if (data.features.HasAppearance()) return data;
  return store_->LoadKeyFrame(data.id);
}

void AtlasProcess::OnTick() {
  status_.AssertLiveliness();
  atlas_.OnTick(Now());
  PublishDecisions();
  for (const SnapshotRequest& request : replicas_.DueRequests(Now(), setup_.process)) {
    snapshot_writer_->Write(request);
    ++snapshots_asked_;
  }
  StoreAPiece();
}

void AtlasProcess::StoreAPiece() {
  if (!saver_ || saver_->IsComplete(replicas_.replicas())) return;
  const Stopwatch stopwatch;
  if (Status stored = saver_->Step(replicas_.replicas(), Now()); !stored) NoteStoreFailure(stored.error());
  DropWhatIsStored();
  times_.Add("store", stopwatch.Milliseconds());
}

void AtlasProcess::DropWhatIsStored() {
  for (const auto& [map, keyframe] : saver_->TakeStored()) replicas_.DropAppearance(map, keyframe);
}

void AtlasProcess::NoteStoreFailure(const Error& error) {
  ++store_failures_;
  if (store_log_.Allow()) spdlog::error("{}; what is not stored is kept and tried again", error.message);
}

Status AtlasProcess::SaveAll() {
  if (!saver_) return Ok{};
  return saver_->SaveAll(replicas_.replicas(), Now(), [this] { status_.AssertLiveliness(); });
}

Reply AtlasProcess::SaveOnRequest() {
  Reply reply;
  if (store_ == nullptr) {
    reply.reason = "this atlas_server has no store: start it with --out or --set atlas.store=FILE";
    return reply;
  }
  const Status saved = SaveAll();
  DropWhatIsStored();
  reply.ok = saved.ok();
  if (!saved) {
    reply.reason = saved.error().message;
    NoteStoreFailure(saved.error());
  }
  return reply;
}

Reply AtlasProcess::ListMaps() const {
  nlohmann::json list = nlohmann::json::array();
  for (const auto& [id, ownership] : atlas_.maps()) {
    nlohmann::json entry = {{"map", ToString(id)},
                            {"robot", ownership.robot},
                            {"epoch", ownership.epoch},
                            {"owner", ToString(ownership.owner)},
                            {"owner_alive", atlas_.IsAlive(ownership.owner, Now())}};
    const auto replica = replicas_.replicas().find(id);
    if (replica != replicas_.replicas().end()) {
      const Map& map = replica->second.map();
      entry["revision"] = map.revision();
      entry["keyframes"] = map.keyframes().size();
      entry["points"] = map.points().size();
    }
    list.push_back(entry);
  }
  Reply reply;
  reply.ok = true;
  reply.text = nlohmann::json{{"maps", list}}.dump();
  return reply;
}

AtlasProcess::Totals AtlasProcess::CountTotals() const {
  Totals totals;
  for (const auto& [id, replica] : replicas_.replicas()) {
    if (replica.map().revision() == 0) continue;
    ++totals.maps;
    totals.keyframes += replica.map().keyframes().size();
    totals.points += replica.map().points().size();
  }
  return totals;
}

void AtlasProcess::OnStatusTimer() {
  const Totals totals = CountTotals();
  const auto replica = replicas_.replicas().find(last_map_);
  const bool known = replica != replicas_.replicas().end();
  const bool failing = saver_ && store_failures_ > 0 && !saver_->IsComplete(replicas_.replicas());
  status_.Publish(failing            ? "the store can't be written"
                  : totals.maps == 0 ? "waiting for a map"
                                     : "following",
                  last_map_, known ? replica->second.map().epoch() : 0, known ? replica->second.map().revision() : 0,
                  {{"maps", static_cast<double>(totals.maps)},
                   {"keyframes", static_cast<double>(totals.keyframes)},
                   {"points", static_cast<double>(totals.points)},
                   {"stored_keyframes", static_cast<double>(store_ == nullptr ? 0 : store_->num_keyframes())},
                   {"pending_requests", static_cast<double>(atlas_.num_pending())},
                   {"grants", static_cast<double>(grants_)},
                   {"takeovers", static_cast<double>(atlas_.num_takeovers())},
                   {"snapshots_sent", static_cast<double>(snapshots_sent_)},
                   {"snapshots_asked", static_cast<double>(snapshots_asked_)},
                   {"store_failures", static_cast<double>(store_failures_)},
                   {"foreign_vocabulary", static_cast<double>(foreign_vocabulary_)},
                   {"events_waiting", static_cast<double>(loop_->depth())},
                   {"events_dropped", static_cast<double>(loop_->dropped())}});
}

int AtlasProcess::Finish() {
  replicas_.ApplyPending();
  int exit_code = kExitOk;
  if (Status saved = SaveAll(); !saved) {
    spdlog::error("{}", saved.error().message);
    exit_code = kExitFailure;
  }
  nlohmann::json report = MakeReport(setup_.options, priority_, times_, *bus_);
  const Totals totals = CountTotals();
  const MapReplica::Counters counters = replicas_.counters();
  report["maps"] = totals.maps;
  report["keyframes"] = totals.keyframes;
  report["points"] = totals.points;
  report["stored_keyframes"] = store_ == nullptr ? 0 : store_->num_keyframes();
  report["store"] = store_ == nullptr ? "" : store_->path();
  report["store_failures"] = store_failures_;
  report["grants"] = grants_;
  report["takeovers"] = atlas_.num_takeovers();
  report["snapshots_sent"] = snapshots_sent_;
  report["snapshots_asked"] = snapshots_asked_;
  report["deltas"] = {{"applied", counters.applied},
                      {"repeated", counters.repeated},
                      {"stale_epoch", counters.stale_epoch},
                      {"gaps", counters.gaps}};
  report["map_hash"] = nlohmann::json::object();
  for (const auto& [id, replica] : replicas_.replicas()) {
    if (replica.map().revision() > 0) report["map_hash"][ToString(id)] = FormatHash(HashMap(replica.map()));
  }
  if (Status written = WriteReport(setup_.options, report); !written) {
    spdlog::error("{}", written.error().message);
    exit_code = kExitFailure;
  }
  return exit_code;
}

}  // namespace portolan
