// Overlaps in the atlas_server: which keyframes are looked up when, what lost trackers ask, and fusions, from the
// search to the maps that are no more.

#include <fmt/format.h>

#include <algorithm>
#include <memory>
#include <utility>

#include "atlas/place_locator.h"
#include "geometry/sim3_alignment.h"
#include "map_optimization/map_fusion.h"
#include "process/atlas_process.h"

namespace portolan {
namespace {

constexpr size_t kMaxRefusals = 500;      // kept for the report
constexpr double kQueryPatienceS = 1.0;   // for the frame that a "locate" request names: it may have been overtaken
constexpr double kLocatePatienceS = 2.0;  // for maps and descriptors that are still to be read
constexpr size_t kFusionKeyFrames = 40;   // of the map that goes, that are looked up for an ordered fusion
constexpr size_t kFusionCandidates = 2;   // of each

/// Where points of both maps, which are the same, lie to each other.
Result<Sim3d> AlignSharedPoints(const Map& map, const Map& other) {
  std::vector<Eigen::Vector3d> in_map, in_other;
  for (const MapPointId id : other.SortedPointIds()) {
    const MapPoint* point = map.FindPoint(id);
    if (point == nullptr) continue;
    in_map.push_back(point->position_in_map.cast<double>());
    in_other.push_back(other.point(id).position_in_map.cast<double>());
  }
  return AlignPoints(in_other, in_map);
}

Reply Refusal(const Error& error) {
  Reply reply;
  reply.reason = error.message;
  return reply;
}

}  // namespace

/// The mapper is done with a keyframe.
void AtlasProcess::QueueKeyFrame(const MapperState& state) {
  KeyFrameId& last = queued_[state.process];
  if (!state.last_keyframe.IsValid()) return;
  FollowerState& follower = followers_[state.last_keyframe.robot()];
  if (state.last_keyframe == last) {
    // Nothing new of the map it has come to.
    if (follower.last_keyframe == last && state.map.IsValid()) follower.map = state.map;
    return;
  }
  last = state.last_keyframe;
  if (!options_.join_maps || shelf_.num_maps() < 2) {
    follower.map = state.map;
    follower.last_keyframe = last;
    return;
  }
  waiting_.push_back({state.map, last, state.revision});
  const auto is_of_robot = [&](const Waiting& w) { return w.keyframe.robot() == last.robot(); };
  if (std::count_if(waiting_.begin(), waiting_.end(), is_of_robot) <= options_.max_waiting) return;
  waiting_.erase(std::find_if(waiting_.begin(), waiting_.end(), is_of_robot));
  ++lookups_.passed_over;
}

/// Looks up one keyframe whose map is here as far as the mapper had it. @return whether more wait that could be looked
/// up.
bool AtlasProcess::LookUpNext() {
  const auto is_here = [this](const Waiting& w) {
    const auto figures = shelf_.FiguresOf(w.map);
    return w.revision == 0 || !figures || figures->revision >= w.revision;
  };
  const auto next = std::find_if(waiting_.begin(), waiting_.end(), is_here);
  if (next == waiting_.end()) return false;
  const Waiting waiting = *next;
  waiting_.erase(next);
  FollowerState& follower = followers_[waiting.keyframe.robot()];
  follower.map = waiting.map;
  follower.last_keyframe = waiting.keyframe;
  joiner_.OnKeyFrame(waiting.map);
  const Map* map = shelf_.BringIn(waiting.map);
  const auto words = shelf_.FindWords(waiting.keyframe);
  if (map != nullptr && words != nullptr && map->FindKeyFrame(waiting.keyframe) != nullptr)
    LookUp(waiting, *map, *words);
  return std::any_of(waiting_.begin(), waiting_.end(), is_here);
}

void AtlasProcess::LookUp(const Waiting& next, const Map& map, const BowVector& bow) {
  const RobotId robot = next.keyframe.robot();
  std::vector<MapId> order = atlas_.graph().ByActivity(map.id());
  order.erase(std::remove_if(order.begin(), order.end(),
                             [&](MapId other) { return !joiner_.WantsOverlap(robot, map.id(), other, Now()); }),
              order.end());
  const std::vector<OtherMap> others = shelf_.Others(order);
  if (others.empty()) return;
  const Stopwatch stopwatch;
  shelf_.BeginLookUp();
  const OverlapDetection detection = detector_.Detect(map, next.keyframe, bow, others, shelf_.Ensurer(), &times_);
  lookup_ms_ = stopwatch.Milliseconds();
  times_.Add("lookup", lookup_ms_);
  ++lookups_.keyframes;
  lookups_.maps += detection.maps;
  lookups_.candidates += static_cast<uint64_t>(detection.candidates);
  lookups_.consistent += static_cast<uint64_t>(detection.consistent);
  lookups_.verified += static_cast<uint64_t>(detection.verified);
  lookups_.confirmed += detection.confirmed ? 1 : 0;
  lookups_.refused += detection.refusals.size();
  for (const OverlapRefusal& refusal : detection.refusals) {
    spdlog::debug("overlap: {} of map {} is not {} of map {}: {}", ToString(refusal.current), ToString(refusal.map),
                  ToString(refusal.candidate), ToString(refusal.other), refusal.reason);
    refusals_.push_back(refusal);
    if (refusals_.size() > kMaxRefusals) refusals_.pop_front();
  }
  if (detection.confirmed) {
    const DetectedOverlap& found = *detection.confirmed;
    spdlog::info("overlap: {} of map {} sees the place of {} of map {} ({} landmarks){}", ToString(found.current),
                 ToString(found.map), ToString(found.matched), ToString(found.other), found.place.group_inliers,
                 detection.overlap ? "" : "; waits for another keyframe to say the same");
  }
  if (detection.overlap) joiner_.OnOverlap(robot, *detection.overlap, Now());
  Trim();
}

void AtlasProcess::TakeOrders() {
  for (const Request& order : atlas_.TakeOrders()) {
    if (order.kind == "swap") {
      succession_.OnOrder(order, Now());
      continue;
    }
    if (order.kind == "activate") {
      if (const Status obeyed = Obey(order); !obeyed) atlas_.RefuseAtLast(order, obeyed.error().message, Now());
      continue;
    }
    Search search{order, {}, "", Now()};
    const Map* other = order.kind == "fuse" ? shelf_.BringIn(order.other) : nullptr;
    if (other != nullptr) {
      // Evenly over the map.
      const size_t all = other->keyframes().size(), chosen = std::min(all, kFusionKeyFrames);
      std::vector<KeyFrameId> ids;
      for (const auto& [id, keyframe] : other->keyframes()) ids.push_back(id);
      for (size_t i = 0; i < chosen; ++i) search.keyframes.push_back(ids[i * all / chosen]);
    }
    searches_.push_back(std::move(search));
  }
}

Status AtlasProcess::Obey(const Request& order) {
  const Result<RobotId> robot = atlas_.RobotOf(order, Now());
  if (!robot) return robot.error();
  if (Status obeys = atlas_.WouldObey(CommandKind::kActivateMap, *robot, Now()); !obeys) return obeys;
  return joiner_.Order(order, *robot, atlas_.Resolve(order.map), Now());
}

/// Only what has happened is ok.
void AtlasProcess::AnswerEndedOrders() {
  for (const auto& [order, record] : joiner_.TakeEndedOrders()) {
    if (!record.is_done) {
      atlas_.Answer(order, Refusal(Error{record.problem}));
      continue;
    }
    Reply reply;
    reply.ok = true;
    reply.text = record.kind == JoinRecord::Kind::kSwitch
                     ? fmt::format("robot {} is in map {}", record.robot, ToString(record.map))
                     : fmt::format("map {} is part of map {}", ToString(record.other), ToString(record.map));
    atlas_.Answer(order, std::move(reply));
  }
}

/// One step of the first.
void AtlasProcess::ContinueSearches() {
  if (searches_.empty()) return;
  Search search = std::move(searches_.front());
  searches_.pop_front();
  if (std::optional<Reply> reply = ContinueSearch(&search)) {
    atlas_.Answer(search.request, std::move(*reply));
  } else if (!search.is_handed_over) {
    searches_.push_back(std::move(search));
    if (searches_.back().request.kind == "fuse" || shelf_.came_short()) loop_->Post([this] { Continue(); });
  }
}

std::optional<Reply> AtlasProcess::ContinueSearch(Search* search) {
  shelf_.BeginEvent();
  if (search->request.kind == "fuse") return LookForFusion(search);
  const auto query = std::find_if(queries_.rbegin(), queries_.rend(), [&](const KeyFrameData& data) {
    return ToString(data.id) == search->request.argument;
  });
  if (query != queries_.rend()) return Locate(*search, *query);
  if (Now() - search->since_s < kQueryPatienceS) return std::nullopt;
  Reply reply;
  reply.reason = "the frame '" + search->request.argument + "' did not come";
  return reply;
}

/// @return none: what it takes is not read yet.
std::optional<Reply> AtlasProcess::Locate(const Search& search, const KeyFrameData& frame) {
  const Request& request = search.request;
  const Stopwatch stopwatch;
  BowVector bow;
  const auto complete = shelf_.Complete(frame, &bow);
  const MapId in = atlas_.MapOf(request.sender);
  std::vector<MapId> order = atlas_.graph().ByActivity(in);
  const Result<LocatedFrame> located =
      LocateFrame(*complete, bow, shelf_.Others(order), shelf_.Ensurer(), options_.locator, &times_);
  Trim();
  times_.Add("lookup_query", stopwatch.Milliseconds());
  if (!located && shelf_.came_short() && Now() - search.since_s < kLocatePatienceS) return std::nullopt;
  Reply reply;
  reply.ok = located.ok();
  if (!located) {
    ++lookups_.not_located;
    reply.reason = located.error().message;
    return reply;
  }
  ++lookups_.located;
  spdlog::info("robot {} is located: frame {} sees what {} of map {} sees ({} inliers)", request.sender.robot(),
               frame.frame, ToString(located->keyframe), ToString(located->map), located->inliers);
  reply.text = ToString(located->map);
  atlas_.Activate(request.sender.robot(), located->map, MapId(), Sim3d());
  return reply;
}

/// Looks for a place of `map` that a keyframe of `other` sees, a keyframe a step.
std::optional<Reply> AtlasProcess::LookForFusion(Search* search) {
  Reply reply;
  const MapId map_id = atlas_.Resolve(search->request.map), other_id = atlas_.Resolve(search->request.other);
  const Map* map = shelf_.BringIn(map_id);
  const Map* other = shelf_.BringIn(other_id);
  const std::vector<OtherMap> in = shelf_.Others({map_id});
  if (map == nullptr || other == nullptr || map == other || in.empty()) {
    reply.reason = "fuse needs two maps with keyframes that can be read, got " + ToString(search->request.map) +
                   " and " + ToString(search->request.other);
    return reply;
  }
  if (search->keyframes.empty()) {
    reply.reason = "no overlap of the two maps found" +
                   (search->reason.empty() ? "" : "; of the last keyframe looked at: " + search->reason);
    return reply;
  }
  const KeyFrameId current = search->keyframes.front();
  search->keyframes.pop_front();
  OverlapOptions options = options_.overlap;
  options.consistent_rounds = 0;
  options.max_verified = static_cast<int>(kFusionCandidates);
  OverlapDetector detector(options);
  const auto words = shelf_.FindWords(current);
  if (words == nullptr || other->FindKeyFrame(current) == nullptr) return std::nullopt;
  const OverlapDetection detection = detector.Detect(*other, current, *words, in, shelf_.Ensurer(), &times_);
  Trim();
  if (!detection.refusals.empty()) search->reason = detection.refusals.front().reason;
  if (!detection.confirmed) return std::nullopt;
  if (const Status begun = joiner_.OrderFusion(search->request, *detection.confirmed, Now()); !begun)
    return Refusal(begun.error());
  search->is_handed_over = true;
  return std::nullopt;
}

/// What the proposal reads around a keyframe. @return false: go on in the next event.
bool AtlasProcess::EnsureAround(const Map& map, KeyFrameId keyframe) {
  std::vector<KeyFrameId> around{keyframe};
  const auto most = static_cast<size_t>(std::max(options_.fusion.max_window, options_.fusion.max_matched_side));
  for (const auto& [id, common] : map.CovisibleKeyFrames(keyframe, 1, most)) around.push_back(id);
  return shelf_.EnsureAppearance(map, around);
}

void AtlasProcess::StartFusion() {
  if (background_.busy()) return;
  if (!fusion_) {
    fusion_ = joiner_.NextFusion(
        [this](MapId id) {
          const Map* map = shelf_.BringIn(id);
          // What comes later follows its ancestors.
          return map != nullptr && !shelf_.maps().at(id).NeedsSnapshot() ? map->epoch() : 0;
        },
        [this](MapId map, MapId other) { return CheckResiduals(*shelf_.FindMap(map), *shelf_.FindMap(other)).ok(); },
        Now());
    if (!fusion_) return;
  }
  const Map* map = shelf_.BringIn(fusion_->map);
  const Map* other = shelf_.BringIn(fusion_->other);
  if (map == nullptr || other == nullptr) {
    fusion_.reset();
    return joiner_.OnProposed(Error{"one of the maps is no more"}, Now());
  }
  const bool turned = fusion_->overlap.map == fusion_->map;
  shelf_.BeginEvent();
  if (!EnsureAround(*map, turned ? fusion_->overlap.current : fusion_->overlap.matched) ||
      !EnsureAround(*other, turned ? fusion_->overlap.matched : fusion_->overlap.current)) {
    loop_->Post([this] { Continue(); });
    return;
  }
  const auto maps = std::make_shared<const std::pair<Map, Map>>(*map, *other);
  const LoopClosure overlap = ToLoopClosure(fusion_->overlap, *map, *other);
  fusion_.reset();
  Trim();
  background_.Start([this, maps, overlap, options = options_.fusion](const std::atomic<bool>& stop) {
    // Events are copied: the result, with thousands of points, is not.
    auto times = std::make_shared<StageTimes>();
    auto proposal = std::make_shared<Result<MapCorrection>>(
        ProposeFusion(maps->first, maps->second, overlap, options, &stop, times.get()));
    return [this, times, proposal] {
      for (const auto& [stage, samples] : times->samples()) {
        for (const double sample : samples) times_.Add(stage, sample);
      }
      joiner_.OnProposed(std::move(*proposal), Now());
      if (const auto correction = joiner_.TakeCorrection()) correction_writer_->Write(*correction);
      Continue();
    };
  });
}

/// `other` is no more; its file stays until `map` is stored with what it had.
void AtlasProcess::OnFused(MapId map, MapId other, Revision revision) {
  detector_.Forget(map);
  detector_.Forget(other);
  shelf_.Remove(other, map);
  if (saver_) {
    saver_->Forget(other);
    to_be_deleted_.push_back({map, other, revision});
  }
  for (Waiting& waiting : waiting_) {
    if (waiting.map == other) waiting = {map, waiting.keyframe, revision};
  }
  for (auto& [robot, follower] : followers_) {
    if (follower.map == other) follower.map = map;
  }
}

/// Maps that were seen to have taken in others by the word of an earlier atlas_server.
void AtlasProcess::TakeUpFusions() {
  for (const auto& [map, other] : shelf_.TakeTakenIn()) {
    if (joiner_.IsFusing(other)) continue;
    const Map* into = shelf_.BringIn(map);
    const Map* from = shelf_.BringIn(other);
    if (into == nullptr || from == nullptr) continue;
    const Result<Sim3d> map_from_other = AlignSharedPoints(*into, *from);
    if (!map_from_other) continue;
    spdlog::info("map {} has taken in map {}: taken up", ToString(map), ToString(other));
    atlas_.Fuse(map, other, *map_from_other);
    OnFused(map, other, into->revision());
  }
}

/// The graph of fused maps only once what they went into is stored: before, the two are what the file has.
void AtlasProcess::SaveGraph() {
  if (store_ == nullptr || !to_be_deleted_.empty() || saved_graph_ == atlas_.graph().version()) return;
  saved_graph_ = atlas_.graph().version();
  if (Status saved = store_->SaveGraph(atlas_.graph().state()); !saved) NoteStoreFailure(saved.error());
}

/// @param all also those that have not changed: a sign of life for who waits for it, and for who came late.
void AtlasProcess::PublishFollowers(bool all) {
  for (auto& [robot, follower] : followers_) {
    FollowerState state = follower;
    state.process = setup_.process;
    const MapShelf::Figures figures = shelf_.FiguresOf(state.map).value_or(MapShelf::Figures());
    state.epoch = figures.epoch;
    state.revision = figures.revision;
    const auto of_robot = robot;
    state.is_busy = joiner_.IsFusing(state.map) ||
                    std::any_of(waiting_.begin(), waiting_.end(),
                                [of_robot](const Waiting& w) { return w.keyframe.robot() == of_robot; });
    FollowerState& published = published_[robot];
    if (!all && state.last_keyframe == published.last_keyframe && state.is_busy == published.is_busy &&
        state.map == published.map)
      continue;
    published = state;
    follower_writer_->Write(state);
  }
}

}  // namespace portolan
