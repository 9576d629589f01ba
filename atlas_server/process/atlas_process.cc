#include "process/atlas_process.h"

#include <malloc.h>

#include <algorithm>
#include <utility>

#include "atlas/map_import.h"
#include "messages/limits.h"
#include "process/held_bytes.h"

namespace portolan {
namespace {

constexpr double kStatusPeriodS = 1.0;
constexpr double kTickPeriodS = 0.15;    // well within the liveliness lease of 500 ms
constexpr int kBackgroundNiceSteps = 2;  // a robot may wait for a fusion
constexpr size_t kMaxQueries = 16;       // of lost trackers, one a second each

}  // namespace

AtlasProcess::AtlasProcess(const ProcessSetup& setup, const AtlasOptions& options,
                           std::shared_ptr<const Vocabulary> vocabulary, std::unique_ptr<MapStore> store,
                           OpenStore open_later, Bus* bus, const std::string& priority, ProcessLoop* loop)
    : setup_(setup),
      vocabulary_hash_(vocabulary->hash()),
      store_(std::move(store)),
      open_later_(std::move(open_later)),
      bus_(bus),
      priority_(priority),
      loop_(loop),
      status_(bus, setup, priority),
      command_writer_(bus->CreateWriter<Command>()),
      reply_writer_(bus->CreateWriter<Reply>()),
      keyframe_writer_(bus->CreateWriter<KeyFrameMessage>()),
      delta_writer_(bus->CreateWriter<MapDeltaChunk>()),
      snapshot_writer_(bus->CreateWriter<SnapshotRequest>()),
      correction_writer_(bus->CreateWriter<MapCorrection>()),
      follower_writer_(bus->CreateWriter<FollowerState>()),
      snapshots_(
          keyframe_writer_.get(), delta_writer_.get(), vocabulary_hash_,
          [this](MapId map) { return shelf_.BringIn(map); },
          [this](const KeyFrameData& data) { return WholeData(data); }),
      options_(options),
      atlas_(setup.process, Now()),
      shelf_(
          options.shelf, std::move(vocabulary),
          [this](KeyFrameId id) {
            status_.AssertLiveliness();  // a map has thousands
            return LoadKeyFrame(id);
          },
          [this](MapId id) { return LoadState(id); }),
      detector_(options.overlap),
      joiner_(setup.process, options.join, &atlas_),
      succession_(setup.process, &atlas_, [this](MapId map) { return shelf_.Measure(map); }),
      request_ids_(setup.options.robot, setup.session),
      background_(loop, kBackgroundNiceSteps) {
  if (store_ != nullptr) saver_.emplace(store_.get(), options.store_interval_s);
  if (store_ != nullptr) store_path_ = store_->path();
  if (setup.options.standby) atlas_.StandBy();
}

AtlasProcess::~AtlasProcess() {
  readers_.clear();
}

Status AtlasProcess::LoadStore() {
  if (store_ == nullptr) return Ok{};
  Result<MapStore::Content> content = store_->LoadWithoutMaps();
  if (!content) return content.error();
  if (atlas_.maps().empty()) {
    atlas_.Restore(content->ownerships, MapGraph(content->graph));
    saved_graph_ = atlas_.graph().version();
  } else {  // stood by: what was heard is newer where it is more
    if (graph_text_.empty()) atlas_.Follow(MapGraph(content->graph));
    atlas_.Follow(content->ownerships);
  }
  const Status loaded =
      store_->LoadEachMap([this](StoredMap stored) { TakeInStored(std::move(stored)); }, &content->problems);
  for (const std::string& problem : content->problems) spdlog::error("{}", problem);
  if (!loaded) return loaded.error();
  malloc_trim(0);  // reading leaves a sixth of the heap empty
  const Totals totals = CountTotals();
  spdlog::info("atlas store '{}': {} maps, {} keyframes, {} points", store_->path(), totals.maps, totals.keyframes,
               totals.points);
  return Ok{};
}

void AtlasProcess::TakeInStored(StoredMap stored) {
  const MapId id = stored.snapshot.map;
  const auto [epoch, revision] = std::pair(stored.snapshot.epoch, stored.snapshot.revision);
  atlas_.OnEpoch(id, epoch);
  TakeIn(std::move(stored), true);
  const Map* map = shelf_.FindMap(id);
  if (map != nullptr) {
    saver_->Restore(id, epoch, revision);
    atlas_.OnSize(id, map->keyframes().size());
  } else if (shelf_.maps().count(id) == 1) {
    spdlog::error("atlas store '{}': map {} is no valid map and left out: {}", store_->path(), ToString(id),
                  shelf_.maps().at(id).last_problem());
  }
  Trim();
}

void AtlasProcess::TakeIn(StoredMap map, bool is_stored) {
  shelf_.TakeIn(std::move(map), is_stored, [this] { status_.AssertLiveliness(); });
  ApplyPending();  // the points take their descriptors
}

/// A map that rests with this atlas_server, or with the one that it stands by behind; before anybody is heard that is
/// every map. Not one that something under way is about.
bool AtlasProcess::MayBePaged(const Map& map) const {
  const MapId id = map.id();
  const auto ownership = atlas_.maps().find(id);
  if (!saver_ || !saver_->IsSaved(map) || ownership == atlas_.maps().end()) return false;
  const ProcessId owner = ownership->second.owner;
  const bool is_dormant =
      owner == setup_.process || !atlas_.IsAlive(owner, Now()) || owner == atlas_.HolderOf(Atlas::kAtlasRole, 0, Now());
  if (!is_dormant || atlas_.IsActive(id, Now()) || joiner_.IsFusing(id) || snapshots_.IsSending(id)) return false;
  const auto is_about_it = [&](const Search& search) {
    return atlas_.Resolve(search.request.map) == id || atlas_.Resolve(search.request.other) == id;
  };
  return std::none_of(waiting_.begin(), waiting_.end(), [id](const Waiting& w) { return w.map == id; }) &&
         std::none_of(searches_.begin(), searches_.end(), is_about_it) &&
         !(fusion_ && (fusion_->map == id || fusion_->other == id));
}

void AtlasProcess::Trim() {
  const size_t paged = shelf_.num_paged();
  shelf_.Trim([this](const Map& map) { return MayBePaged(map); });
  if (shelf_.num_paged() > paged) malloc_trim(0);
}

void AtlasProcess::ConnectReaders() {
  const auto post = [this](auto handle) {
    return [this, handle](auto message) {
      const size_t held_bytes = HeldBytes(message);
      loop_->Post([this, handle, message = std::move(message)] { (this->*handle)(message); }, held_bytes);
    };
  };
  readers_.push_back(bus_->CreateReader<ProcessStatus>(post(&AtlasProcess::OnStatus)));
  readers_.push_back(bus_->CreateReader<MapperState>(post(&AtlasProcess::OnMapperState)));
  readers_.push_back(bus_->CreateReader<KeyFrameMessage>(post(&AtlasProcess::OnKeyFrame)));
  readers_.push_back(bus_->CreateReader<MapDeltaChunk>(post(&AtlasProcess::OnDeltaChunk)));
  readers_.push_back(bus_->CreateReader<SnapshotRequest>(post(&AtlasProcess::OnSnapshotRequest)));
  readers_.push_back(bus_->CreateReader<Request>(post(&AtlasProcess::OnRequest)));
  readers_.push_back(bus_->CreateReader<Command>(post(&AtlasProcess::OnCommand)));
  if (atlas_.is_standby()) ConnectStandby();
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
  if (status.map.IsValid() && status.epoch > 0) shelf_.Announce(status.map, status.epoch, status.revision);
  Continue();
}

void AtlasProcess::OnMapperState(const MapperState& state) {
  if (state.map.IsValid()) shelf_.Announce(state.map, state.epoch, state.revision);
  atlas_.OnMapperState(state, Now());
  if (atlas_.is_standby()) return Continue();
  joiner_.OnMapperState(state, Now());
  QueueKeyFrame(state);
  Continue();
}

void AtlasProcess::OnKeyFrame(const KeyFrameMessage& message) {
  if (message.vocabulary_hash != vocabulary_hash_) {
    if (foreign_vocabulary_++ == 0) {
      spdlog::error("keyframes made with another vocabulary ({:016x}, here {:016x}) are passed over",
                    message.vocabulary_hash, vocabulary_hash_);
    }
    return;
  }
  if (message.kind == KeyFrameKind::kQuery) {
    if (atlas_.is_standby()) return;
    queries_.push_back(message.data);
    if (queries_.size() > kMaxQueries) queries_.pop_front();
    return Continue();
  }
  if (!message.map.IsValid()) return;
  const Stopwatch stopwatch;
  shelf_.AddKeyFrame(atlas_.Resolve(message.map), message.data);
  if (store_ != nullptr && store_->HasKeyFrame(message.data.id)) shelf_.OnStored(message.data.id);
  times_.Add("keyframe_words", stopwatch.Milliseconds());
  Continue();
}

void AtlasProcess::OnDeltaChunk(const MapDeltaChunk& chunk) {
  atlas_.OnEpoch(chunk.part.map, chunk.part.epoch);
  shelf_.AddChunk(chunk);
  Continue();
}

void AtlasProcess::ApplyPending() {
  const Stopwatch stopwatch;
  const std::vector<MapDelta> applied = shelf_.ApplyPending();
  if (applied.empty()) return;
  last_map_ = applied.back().map;
  for (const MapDelta& delta : applied) {
    atlas_.OnSize(delta.map, shelf_.maps().at(delta.map).map().keyframes().size());
    if (saver_) saver_->OnApplied(delta);
  }
  times_.Add("apply", stopwatch.Milliseconds());
}

void AtlasProcess::Continue() {
  ApplyPending();
  TakeUpFusions();
  PublishDecisions();
  // A keyframe at a time: what waits behind it, timers among them, gets its turn.
  if (LookUpNext()) loop_->Post([this] { Continue(); });
  ContinueSearches();
  StartFusion();
  PublishDecisions();
  PublishFollowers(false);
}

void AtlasProcess::OnRequest(const Request& request) {
  if (atlas_.is_standby()) return;  // the other answers
  if (request.kind == "holds_map" || request.kind == "drained") {
    atlas_.OnSignOfLife(request.sender, Now());
    succession_.OnReport(request, Now());
    return Continue();
  }
  std::optional<Reply> reply;
  if (request.kind == "save") reply = SaveOnRequest();
  if (request.kind == "list_maps") reply = ListMaps();
  if (request.kind == "map_graph") reply = DescribeGraph(request.argument);
  if (request.kind == "import_map") reply = ImportMaps(request);
  if (!reply) {
    atlas_.OnRequest(request, Now());
    return Continue();
  }
  reply->id = request.id;
  reply->sender = setup_.process;
  reply_writer_->Write(*reply);
}

/// Takes the maps of a file in, all or none: as dormant maps, with the links between them. They are stored when the
/// answer is ok. Asked for again, because the answer was lost, it says the same.
Reply AtlasProcess::ImportMaps(const Request& request) {
  Reply reply;
  if (const auto imported = imports_.find(request.id); imported != imports_.end()) {
    reply.ok = true;
    reply.text = imported->second;
    return reply;
  }
  Result<MapStore::Content> content = ReadMapsOf(request.argument);
  if (!content) {
    reply.reason = content.error().message;
    return reply;
  }
  for (const std::string& problem : content->problems) spdlog::error("{}", problem);
  for (const StoredMap& map : content->maps) {
    const MapId id = map.snapshot.map;
    const Result<Map> restored = RestoreMap(map, nullptr);
    if (!restored) {
      reply.reason = request.argument + ": map " + ToString(id) + ": " + restored.error().message;
    } else if (atlas_.maps().count(id) == 1 || shelf_.FiguresOf(id)) {
      reply.reason = "map " + ToString(id) + " is in this atlas already";
    } else if (atlas_.Resolve(id) != id) {
      reply.reason = "map " + ToString(id) + " was in this atlas, and went into map " + ToString(atlas_.Resolve(id));
    }
    for (const KeyFrameData& data : map.keyframes) {
      if (shelf_.FindWords(data.id) != nullptr)
        reply.reason = "keyframe " + ToString(data.id) + " of map " + ToString(id) + " is in this atlas already";
    }
    if (!reply.reason.empty()) return reply;
  }
  for (StoredMap& map : content->maps) {
    const MapId id = map.snapshot.map;
    // What was deleted here is ignored up to the last epoch that was heard of it.
    map.snapshot.epoch =
        std::max({map.snapshot.epoch, atlas_.DeletedEpoch(id) + 1, shelf_.replicas().RemovedEpoch(id) + 1});
    atlas_.Adopt(id, map.snapshot.epoch);
    TakeIn(std::move(map), false);
    reply.text += (reply.text.empty() ? "" : " ") + ToString(id);
  }
  for (const MapStore::Link& link : content->graph.links) {
    if (atlas_.maps().count(link.map) == 1 && atlas_.maps().count(link.other) == 1) atlas_.LinkMaps(link);
  }
  Continue();
  if (const Status saved = SaveAll(); !saved) NoteStoreFailure(saved.error());  // kept in memory, and tried again
  DropWhatIsStored();
  imports_[request.id] = reply.text;
  reply.ok = true;
  return reply;
}

/// What was granted is on the disk before anybody hears of it: an atlas_server that comes after this one goes on above
/// these epochs. A store that fails holds nobody up: epochs are learned from living mappers too.
void AtlasProcess::PublishDecisions() {
  if (atlas_.is_standby()) return SaveGraph();
  for (const Atlas::Move& move : atlas_.TakeMoves()) joiner_.OnMove(move, Now());
  TakeOrders();
  for (const MapJoiner::Done& done : joiner_.TakeDone()) OnFused(done.map, done.other, done.revision);
  AnswerEndedOrders();
  for (const MapId map : atlas_.TakeDeleted()) {
    shelf_.Remove(map);
    detector_.Forget(map);
    if (!saver_) continue;
    saver_->Forget(map);
    if (Status deleted = store_->DeleteMap(map); !deleted) NoteStoreFailure(deleted.error());
  }
  SaveGraph();
  for (const Atlas::Ownership& granted : atlas_.TakeGrants()) {
    spdlog::info("map {} of robot {}: owner {}, epoch {}", ToString(granted.map), granted.robot,
                 ToString(granted.owner), granted.epoch);
    ++grants_;
    if (store_ == nullptr) continue;
    if (Status saved = store_->SaveOwnership(granted); !saved) NoteStoreFailure(saved.error());
  }
  for (const Command& command : atlas_.TakeCommands()) command_writer_->Write(command);
  for (const Reply& reply : atlas_.TakeReplies()) {
    if (!reply.ok) spdlog::info("refused: {}", reply.reason);
    reply_writer_->Write(reply);
  }
}

/// Owner of the dormant maps; stands in for owners that don't live, and serves a new owner that asks for the map it was
/// granted.
void AtlasProcess::OnSnapshotRequest(const SnapshotRequest& request) {
  if (request.asker == setup_.process || atlas_.is_standby()) return;
  const auto ownership = atlas_.maps().find(request.map);
  if (ownership == atlas_.maps().end()) return;
  const auto& [map, robot, epoch, owner] = ownership->second;
  if (owner.IsValid() && owner != setup_.process && owner != request.asker && atlas_.IsAlive(owner, Now())) return;
  const auto figures = shelf_.FiguresOf(map);
  spdlog::debug("{} asks for map {}, has revision {} and {} keyframes", ToString(request.asker), ToString(request.map),
                request.have_revision, request.have_keyframes.size());
  if (figures && figures->revision > 0) {
    snapshots_.Add(request);
    if (!snapshots_go_on_) SendSnapshots();
  } else if (store_ != nullptr && store_->IsDamaged(map)) {
    if (store_log_.Allow())
      spdlog::error("map {} is damaged in the store: {} does not get it", ToString(map),
                    atlas_.Describe(request.asker));
  } else if (owner == request.asker && shelf_.IsEmpty(map)) {  // its last owner had not begun it
    for (const MapDeltaChunk& chunk : SplitDelta(Map(map, epoch - 1).Snapshot(), kDeltaChunkElements))
      delta_writer_->Write(chunk);
  }
}

/// A piece at a time: what waits behind it gets its turn.
void AtlasProcess::SendSnapshots() {
  const Stopwatch stopwatch;
  snapshots_go_on_ = snapshots_.SendPiece(Now()) && loop_->Post([this] { SendSnapshots(); });
  status_.AssertLiveliness();
  times_.Add("snapshot_piece", stopwatch.Milliseconds());
}

Result<KeyFrameData> AtlasProcess::WholeData(const KeyFrameData& data) {
  if (data.features.HasAppearance()) return data;
  return LoadKeyFrame(data.id);
}

Result<KeyFrameData> AtlasProcess::LoadKeyFrame(KeyFrameId id) {
  if (store_ == nullptr) return Error{"keyframe " + ToString(id) + " is in no store"};
  return store_->LoadKeyFrame(id);
}

Result<MapDelta> AtlasProcess::LoadState(MapId id) {
  if (store_ == nullptr) return Error{"map " + ToString(id) + " is in no store"};
  return store_->LoadState(id);
}

void AtlasProcess::OnTick() {
  status_.AssertLiveliness();
  atlas_.OnTick(Now());
  if (atlas_.is_standby()) {
    StandByTick();
  } else {
    joiner_.OnTick(Now());
    succession_.OnTick(Now());
    LeaveIfAsked();
    if (open_later_) OpenStoreNow();
  }
  Continue();
  if (!snapshots_go_on_ && !snapshots_.IsIdle()) SendSnapshots();
  for (const SnapshotRequest& request : shelf_.replicas().DueRequests(Now(), setup_.process)) {
    snapshot_writer_->Write(request);
    ++snapshots_asked_;
  }
  StoreAPiece();
  Trim();
}

void AtlasProcess::StoreAPiece() {
  if (!saver_) return;
  const Stopwatch stopwatch;
  const Result<bool> stored = saver_->Step(shelf_.maps(), Now());
  if (!stored) NoteStoreFailure(stored.error());
  if (stored && !*stored) return;
  DropWhatIsStored();
  times_.Add("store", stopwatch.Milliseconds());
}

void AtlasProcess::DropWhatIsStored() {
  for (const auto& [map, keyframe] : saver_->TakeStored()) shelf_.OnStored(keyframe);
  Trim();
  for (auto next = to_be_deleted_.begin(); next != to_be_deleted_.end();) {
    if (!saver_->HasSaved(next->map, next->revision)) {
      ++next;
      continue;
    }
    if (Status deleted = store_->DeleteMap(next->other); !deleted) NoteStoreFailure(deleted.error());
    next = to_be_deleted_.erase(next);
  }
  SaveGraph();
}

void AtlasProcess::NoteStoreFailure(const Error& error) {
  ++store_failures_;
  if (store_log_.Allow()) spdlog::error("{}; what is not stored is kept and tried again", error.message);
}

Status AtlasProcess::SaveAll() {
  if (!saver_) return Ok{};
  return saver_->SaveAll(shelf_.maps(), Now(), [this] { status_.AssertLiveliness(); });
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

}  // namespace portolan
