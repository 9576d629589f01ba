#include "loop/loop_closer.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <future>

#include "loop/loop_test_scene.h"
#include "map_optimization/map_correction.h"
#include "testing/matchers.h"

namespace portolan {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;
using JobKind = LoopCloser::JobKind;

const ProcessId kProcess(0, 1, 7), kMapper(0, 1, 1);
const ProcessId kAtlas(0, 2, 2);  // which has robot 0 too
const std::atomic<bool> kGoOn{false};

/// A map's owner that has seen one pass and sends the second, keyframe by keyframe, to a LoopCloser.
class LoopCloserTest : public ::testing::Test {
 protected:
  explicit LoopCloserTest(const LoopOptions& options = Options()) : closer_(options, passes_.vocabulary, kProcess) {
    closer_.follower().Follow(owner_.id());
    SendDelta();  // first: a follower keeps but a few keyframes that no delta has named
    for (const SyntheticScene* scene : {&passes_.first, &passes_.second}) {
      for (const SyntheticView& view : scene->views) Send(*view.data);
    }
  }
  static LoopOptions Options() {
    LoopOptions options;
    options.forward_every_keyframes = 100000;
    return options;
  }

  void Send(const KeyFrameData& data) {
    KeyFrameMessage message;
    message.kind = KeyFrameKind::kCopy;
    message.map = owner_.id();
    message.data = data;
    message.vocabulary_hash = passes_.vocabulary->hash();
    ASSERT_TRUE(closer_.follower().AddKeyFrame(message));
  }
  void SendDelta() {
    for (const MapDeltaChunk& chunk : SplitDelta(owner_.TakeDelta(), 1000)) closer_.follower().AddChunk(chunk);
  }
  void Acknowledge(KeyFrameId keyframe) {
    state_.process = kMapper;
    state_.map = owner_.id();
    state_.epoch = owner_.epoch();
    state_.revision = owner_.revision();
    state_.last_keyframe = keyframe;
    closer_.OnMapperState(state_);
    while (closer_.Update()) {
    }
  }
  /// Acknowledges keyframes of the second pass until a loop is found that was not before. @return whether there was.
  bool FindLoop() {
    const size_t before = closer_.closures().size();
    for (; next_view_ < passes_.second.views.size(); ++next_view_) {
      Acknowledge(passes_.second.views[next_view_].data->id);
      if (closer_.closures().size() > before) return true;
    }
    return false;
  }
  /// The map goes on under another owner, who sends all of it.
  void SendInEpoch(Epoch epoch) {
    owner_.SetEpoch(epoch);
    for (const MapDeltaChunk& chunk : SplitDelta(owner_.Snapshot(), 1000)) closer_.follower().AddChunk(chunk);
    closer_.Update();
  }
  void Grant(ProcessId owner, Epoch epoch) {
    Command grant;
    grant.kind = CommandKind::kGrantOwnership;
    grant.map = owner_.id();
    grant.epoch = epoch;
    grant.owner = owner;
    grant.sender = kAtlas;
    closer_.OnCommand(grant);
  }
  /// Nothing was proposed, and the loop that is still open is found again and closed.
  void ExpectNothingProposedThenClosed() {
    EXPECT_FALSE(closer_.TakeCorrection());
    EXPECT_TRUE(closer_.IsAtRest());
    EXPECT_FALSE(closer_.NextJob());
    EXPECT_EQ(closer_.counters().failed, 1u);
    ASSERT_TRUE(FindLoop()) << "the loop is still open";
    ASSERT_EQ(RunJob(), JobKind::kLoop);
    const auto correction = closer_.TakeCorrection();
    ASSERT_TRUE(correction);
    EXPECT_EQ(correction->epoch, owner_.epoch());
    Answer(*correction);
    EXPECT_TRUE(closer_.closures().back().is_applied) << closer_.closures().back().problem;
    EXPECT_EQ(closer_.counters().closed, 1u);
    EXPECT_TRUE(ValidateMap(owner_).empty());
  }
  void Answer(const MapCorrection& correction) {
    const auto applied = ApplyMapCorrection(correction, &owner_);
    SendDelta();
    state_.correction_process = correction.process;
    state_.correction_number = correction.number;
    state_.correction_refusal = applied.ok() ? "" : applied.error().message;
    state_.revision = owner_.revision();
    closer_.OnMapperState(state_);
    while (closer_.Update()) {
    }
  }
  void AskForGlobal() {
    Command adjust;
    adjust.kind = CommandKind::kAdjustMap;
    adjust.map = owner_.id();
    closer_.OnCommand(adjust);
  }
  /// What a job of that kind, which is due, might propose: the second pass moved. The job itself is not run.
  MapCorrection Propose(JobKind kind, const Sim3d& new_from_old) {
    EXPECT_TRUE(closer_.NextJob());
    LoopCloser::JobResult result;
    result.kind = kind;
    result.map = owner_.id();
    MapCorrection correction = EmptyCorrection(owner_, "global_ba");
    for (const SyntheticView& view : passes_.second.views) {
      const Sim3d old(owner_.keyframe(view.data->id).camera_from_map);
      correction.keyframes.push_back({view.data->id, old * new_from_old.Inverse()});
    }
    result.correction = std::move(correction);
    closer_.OnJobDone(std::move(result));
    return closer_.TakeCorrection().value();
  }
  void Refuse(const MapCorrection& correction) {
    state_.correction_process = correction.process;
    state_.correction_number = correction.number;
    state_.correction_refusal = "the map was corrected at";
    closer_.OnMapperState(state_);
  }
  /// Runs what is due, on this thread. @return its kind, none if nothing was due.
  std::optional<JobKind> RunJob() {
    auto job = closer_.NextJob();
    if (!job) return std::nullopt;
    LoopCloser::JobResult result = (*job)(kGoOn);
    const JobKind kind = result.kind;
    closer_.OnJobDone(std::move(result));
    return kind;
  }

  const TwoPasses passes_ = MakeTwoPasses(PlaceSceneOptions());
  Map owner_ = MapWithLoop(passes_);
  LoopCloser closer_;
  MapperState state_;
  size_t next_view_ = 0;
};

TEST_F(LoopCloserTest, OneThatStandsByFollowsAndProposesNothing) {
  closer_.SetActive(false);
  EXPECT_FALSE(FindLoop());
  EXPECT_FALSE(RunJob());
  EXPECT_EQ(closer_.last_keyframe(), passes_.second.views.back().data->id) << "nobody has to wait for it";
  EXPECT_TRUE(closer_.IsAtRest());
  Command adjust;
  adjust.kind = CommandKind::kAdjustMap;
  adjust.map = owner_.id();
  closer_.OnCommand(adjust);
  EXPECT_FALSE(RunJob());
  closer_.SetActive(true);
  next_view_ = 0;
  EXPECT_TRUE(FindLoop()) << "its replica and index are as warm as any";
}

TEST_F(LoopCloserTest, OneThatLeavesEndsItsLoopAndBeginsNothing) {
  ASSERT_TRUE(FindLoop());
  closer_.SetActive(false);
  EXPECT_FALSE(closer_.IsAtRest());
  ASSERT_EQ(RunJob(), JobKind::kLoop);
  const auto loop = closer_.TakeCorrection();
  ASSERT_TRUE(loop);
  EXPECT_FALSE(closer_.IsAtRest()) << "not answered";
  Answer(*loop);
  EXPECT_TRUE(closer_.IsAtRest());
  EXPECT_EQ(closer_.counters().closed, 1u);
  EXPECT_FALSE(RunJob()) << "the global BA is the other's";
}

TEST_F(LoopCloserTest, ClosesALoopThenAdjustsTheWholeMap) {
  const KeyFrameId seen_again = passes_.second.views[10].data->id;
  const auto error = [&] {  // of where the second pass lies, against the first
    return (owner_.keyframe(seen_again).camera_from_map.TargetOriginInSource() -
            passes_.second.views[10].camera_from_world.TargetOriginInSource())
        .norm();
  };
  const double before = error();
  EXPECT_GT(before, 0.1);
  ASSERT_TRUE(FindLoop());
  EXPECT_TRUE(closer_.is_busy());
  ASSERT_EQ(RunJob(), JobKind::kLoop);
  const auto loop = closer_.TakeCorrection();
  ASSERT_TRUE(loop);
  EXPECT_EQ(loop->kind, "loop");
  EXPECT_EQ(loop->process, kProcess);
  EXPECT_FALSE(closer_.TakeCorrection()) << "once";
  EXPECT_FALSE(RunJob()) << "the owner has not answered";
  Answer(*loop);
  ASSERT_EQ(closer_.closures().size(), 1u);
  EXPECT_TRUE(closer_.closures().front().is_applied) << closer_.closures().front().problem;
  EXPECT_LT(error(), 0.05 * before);
  EXPECT_TRUE(ValidateMap(owner_).empty());

  ASSERT_EQ(RunJob(), JobKind::kGlobalBundleAdjustment);
  EXPECT_TRUE(closer_.counters().of(JobKind::kGlobalBundleAdjustment).losses);
  // A map without noise may leave nothing to improve.
  if (const auto global = closer_.TakeCorrection()) Answer(*global);
  EXPECT_FALSE(closer_.is_busy());
  EXPECT_EQ(closer_.counters().closed, 1u);
}

TEST_F(LoopCloserTest, ALoopIsNotClosedTwice) {
  ASSERT_TRUE(FindLoop());
  ASSERT_EQ(RunJob(), JobKind::kLoop);
  Answer(*closer_.TakeCorrection());
  RunJob();
  if (const auto global = closer_.TakeCorrection()) Answer(*global);
  const uint64_t before = closer_.counters().looked_at;
  for (size_t view = next_view_ + 1; view < passes_.second.views.size(); ++view)
    Acknowledge(passes_.second.views[view].data->id);
  EXPECT_GT(closer_.counters().looked_at, before);
  EXPECT_EQ(closer_.closures().size(), 1u);
}

TEST_F(LoopCloserTest, ARefusedCorrectionLeavesTheLoopOpen) {
  ASSERT_TRUE(FindLoop());
  ASSERT_EQ(RunJob(), JobKind::kLoop);
  MapCorrection stale = *closer_.TakeCorrection();
  stale.epoch += 1;  // as if another owner had the map by now
  Answer(stale);
  EXPECT_FALSE(closer_.closures().front().is_applied);
  EXPECT_THAT(closer_.closures().front().problem, HasSubstr("epoch"));
  EXPECT_EQ(closer_.counters().failed, 1u);
  EXPECT_FALSE(closer_.NextJob()) << "no global BA without a loop";
}

TEST_F(LoopCloserTest, AnOwnerThatDoesNotAnswerIsForgotten) {
  ASSERT_TRUE(FindLoop());
  ASSERT_EQ(RunJob(), JobKind::kLoop);
  ASSERT_TRUE(closer_.TakeCorrection());
  EXPECT_TRUE(closer_.AwaitsAnswer());
  closer_.ForgetCorrection("no answer");
  EXPECT_FALSE(closer_.AwaitsAnswer());
  EXPECT_EQ(closer_.closures().front().problem, "no answer");
}

/// It hung, with the correction in its queue.
TEST_F(LoopCloserTest, AnAnswerThatComesLateCounts) {
  ASSERT_TRUE(FindLoop());
  ASSERT_EQ(RunJob(), JobKind::kLoop);
  const auto loop = closer_.TakeCorrection();
  closer_.ForgetCorrection("no answer");
  EXPECT_EQ(closer_.counters().failed, 1u);
  EXPECT_EQ(closer_.counters().of(JobKind::kLoop).unanswered, 1u);
  Answer(*loop);
  EXPECT_TRUE(closer_.closures().front().is_applied);
  EXPECT_EQ(closer_.closures().front().problem, "");
  EXPECT_EQ(closer_.counters().failed, 0u);
  EXPECT_EQ(closer_.counters().closed, 1u);
  EXPECT_EQ(closer_.counters().of(JobKind::kLoop).unanswered, 0u);
  EXPECT_EQ(closer_.counters().of(JobKind::kLoop).applied, 1u);
  EXPECT_EQ(RunJob(), JobKind::kGlobalBundleAdjustment);
  closer_.OnMapperState(state_);  // says it again and again
  EXPECT_EQ(closer_.counters().closed, 1u);
}

TEST_F(LoopCloserTest, ALateRefusalIsTheReason) {
  ASSERT_TRUE(FindLoop());
  ASSERT_EQ(RunJob(), JobKind::kLoop);
  const auto loop = closer_.TakeCorrection();
  closer_.ForgetCorrection("no answer");
  Refuse(*loop);
  EXPECT_FALSE(closer_.closures().front().is_applied);
  EXPECT_THAT(closer_.closures().front().problem, HasSubstr("was corrected"));
  EXPECT_EQ(closer_.counters().failed, 1u) << "once";
  EXPECT_FALSE(closer_.NextJob());
}

TEST_F(LoopCloserTest, ALateAnswerOfAnOwnerThatLostTheMapDoesNotCount) {
  ASSERT_TRUE(FindLoop());
  ASSERT_EQ(RunJob(), JobKind::kLoop);
  const auto loop = closer_.TakeCorrection();
  closer_.ForgetCorrection("no answer");
  Grant(kMapper, owner_.epoch() + 1);  // to one that may have begun without it
  Answer(*loop);
  EXPECT_FALSE(closer_.closures().front().is_applied);
  EXPECT_EQ(closer_.counters().closed, 0u);
}

/// The loop was found again, in the map without it, and the owner says that it has it.
TEST_F(LoopCloserTest, WhatWasFoundSinceALateAnswerIsDropped) {
  ASSERT_TRUE(FindLoop());
  ASSERT_EQ(RunJob(), JobKind::kLoop);
  const auto loop = closer_.TakeCorrection();
  closer_.ForgetCorrection("no answer");
  ASSERT_TRUE(FindLoop());
  Answer(*loop);
  ASSERT_EQ(closer_.closures().size(), 2u);
  EXPECT_TRUE(closer_.closures()[0].is_applied);
  EXPECT_THAT(closer_.closures()[1].problem, HasSubstr("corrected meanwhile"));
  EXPECT_EQ(RunJob(), JobKind::kGlobalBundleAdjustment) << "no loop correction";
}

TEST_F(LoopCloserTest, AJobOnTheMapWithoutALateCorrectionEnds) {
  ASSERT_TRUE(FindLoop());
  ASSERT_EQ(RunJob(), JobKind::kLoop);
  const auto loop = closer_.TakeCorrection();
  closer_.ForgetCorrection("no answer");
  ASSERT_TRUE(FindLoop());
  ASSERT_TRUE(closer_.NextJob());
  EXPECT_FALSE(closer_.ShouldCancel());
  Answer(*loop);
  EXPECT_TRUE(closer_.ShouldCancel());
  closer_.OnJobCancelled();
  EXPECT_THAT(closer_.closures()[1].problem, HasSubstr("corrected meanwhile"));
  EXPECT_TRUE(closer_.closures()[0].is_applied);
  EXPECT_FALSE(closer_.ShouldCancel());
}

TEST_F(LoopCloserTest, AGlobalAdjustmentThatWasRefusedIsMadeAgainOnce) {
  Acknowledge(passes_.second.views[0].data->id);
  AskForGlobal();
  Refuse(Propose(JobKind::kGlobalBundleAdjustment, Sim3d()));
  EXPECT_EQ(closer_.counters().of(JobKind::kGlobalBundleAdjustment).refused, 1u);
  Refuse(Propose(JobKind::kGlobalBundleAdjustment, Sim3d()));
  EXPECT_FALSE(closer_.NextJob()) << "it is not the map that it is made from";
}

TEST_F(LoopCloserTest, AGlobalAdjustmentThatWasRefusedLateIsMadeAgain) {
  Acknowledge(passes_.second.views[0].data->id);
  AskForGlobal();
  const MapCorrection global = Propose(JobKind::kGlobalBundleAdjustment, Sim3d());
  closer_.ForgetCorrection("no answer");
  EXPECT_FALSE(closer_.NextJob());
  Refuse(global);
  EXPECT_EQ(RunJob(), JobKind::kGlobalBundleAdjustment);
}

/// What a keyframe measured before a global BA is no evidence for or against what another measures after it.
TEST_F(LoopCloserTest, ConfirmationsFromBeforeAGlobalAdjustmentAreForgotten) {
  while (closer_.counters().confirmed == 0) Acknowledge(passes_.second.views[next_view_++].data->id);
  ASSERT_TRUE(closer_.closures().empty()) << "one is not enough";
  AskForGlobal();
  Answer(Propose(JobKind::kGlobalBundleAdjustment, Sim3d(1, Eigen::Quaterniond::Identity(), {0, 0, 2})));
  EXPECT_EQ(closer_.counters().of(JobKind::kGlobalBundleAdjustment).applied, 1u);
  Acknowledge(passes_.second.views[next_view_++].data->id);
  EXPECT_EQ(closer_.counters().confirmed, 2u);
  EXPECT_TRUE(closer_.closures().empty());
  EXPECT_TRUE(FindLoop());
  EXPECT_EQ(closer_.counters().refusals_of(RefusalKind::kContradicted), 0u);
}

/// The new owner had not heard of the correction: it goes on from a lower revision.
TEST_F(LoopCloserTest, ATakeoverAtALowerRevisionIsNotWaitedFor) {
  ASSERT_TRUE(FindLoop());
  ASSERT_EQ(RunJob(), JobKind::kLoop);
  const MapCorrection loop = *closer_.TakeCorrection();
  Map before = owner_;
  ASSERT_TRUE(ApplyMapCorrection(loop, &owner_).ok());
  owner_.TakeDelta();  // comes to nobody
  state_.correction_process = loop.process;
  state_.correction_number = loop.number;
  state_.revision = owner_.revision();
  closer_.OnMapperState(state_);
  state_.last_keyframe = passes_.second.views[++next_view_].data->id;  // the last that it took in
  closer_.OnMapperState(state_);
  const uint64_t looked_at = closer_.counters().looked_at;
  EXPECT_FALSE(closer_.Update());
  EXPECT_EQ(closer_.counters().looked_at, looked_at) << "waits for the delta";

  owner_ = std::move(before);
  SendInEpoch(owner_.epoch() + 1);
  EXPECT_EQ(closer_.counters().looked_at, looked_at + 1) << "there is nothing to wait for";
  Acknowledge(passes_.second.views[++next_view_].data->id);
  EXPECT_EQ(closer_.counters().looked_at, looked_at + 2);
}

TEST_F(LoopCloserTest, AGlobalAdjustmentEndsForALoop) {
  Acknowledge(passes_.second.views[next_view_++].data->id);
  AskForGlobal();
  ASSERT_TRUE(closer_.NextJob());
  EXPECT_FALSE(closer_.ShouldCancel());
  ASSERT_TRUE(FindLoop());
  EXPECT_TRUE(closer_.ShouldCancel());
  closer_.OnJobCancelled();
  EXPECT_EQ(closer_.counters().of(JobKind::kGlobalBundleAdjustment).cancelled, 1u);
  ASSERT_EQ(RunJob(), JobKind::kLoop) << "first";
  EXPECT_FALSE(closer_.ShouldCancel());
  Answer(*closer_.TakeCorrection());
  EXPECT_EQ(RunJob(), JobKind::kGlobalBundleAdjustment) << "then what it was in the way of";
}

TEST_F(LoopCloserTest, ALoopThatIsOpenWhenTheRunEndsIsReported) {
  ASSERT_TRUE(FindLoop());
  ASSERT_TRUE(closer_.NextJob());
  closer_.End();
  EXPECT_FALSE(closer_.closures().front().is_applied);
  EXPECT_EQ(closer_.closures().front().problem, "the run ended");
  EXPECT_EQ(closer_.counters().failed, 1u);
  EXPECT_EQ(closer_.counters().of(JobKind::kLoop).cancelled, 1u);
  EXPECT_FALSE(closer_.is_busy());
}

TEST_F(LoopCloserTest, AClosureHasTheTimesOfAllItsSteps) {
  ASSERT_TRUE(FindLoop());
  ASSERT_EQ(RunJob(), JobKind::kLoop);
  Answer(*closer_.TakeCorrection());
  const auto& steps = closer_.closures().front().times.samples();
  for (const char* step : {"words", "verify", "loop_window", "loop_fusion", "loop_welding", "loop_graph", "applied"}) {
    EXPECT_EQ(steps.count(step), 1u) << step;
  }
}

/// A correction at work on a thread of its own, as LoopProcess has it: from the moment it has begun.
class CorrectionAtWork {
 public:
  explicit CorrectionAtWork(LoopCloser::Job job) {
    result_ = std::async(std::launch::async, [this, job = std::move(job)] {
      begun_.set_value();
      return job(stop_);
    });
    begun_.get_future().wait();
  }
  LoopCloser::JobResult Stop() {
    stop_ = true;
    return result_.get();
  }

 private:
  std::atomic<bool> stop_{false};
  std::promise<void> begun_;
  std::future<LoopCloser::JobResult> result_;
};

TEST_F(LoopCloserTest, ACorrectionEndsWhenTheMapChangesOwner) {
  ASSERT_TRUE(FindLoop());
  auto job = closer_.NextJob();
  ASSERT_TRUE(job);
  CorrectionAtWork work(std::move(*job));
  EXPECT_FALSE(closer_.ShouldCancel());
  SendInEpoch(owner_.epoch() + 1);  // of a mapper that came after one that died
  EXPECT_TRUE(closer_.ShouldCancel());
  work.Stop();  // what came of it, if anything, is of an epoch gone by
  closer_.OnJobCancelled();
  EXPECT_FALSE(closer_.ShouldCancel());
  EXPECT_EQ(closer_.counters().cancelled(), 1u);
  EXPECT_FALSE(closer_.closures().front().is_applied);
  ExpectNothingProposedThenClosed();
}

TEST_F(LoopCloserTest, ACorrectionEndsWhenTheMapIsSwitchedAwayFrom) {
  ASSERT_TRUE(FindLoop());
  auto job = closer_.NextJob();
  ASSERT_TRUE(job);
  CorrectionAtWork work(std::move(*job));
  Grant(kAtlas, owner_.epoch() + 1);  // dormant
  EXPECT_TRUE(closer_.ShouldCancel());
  work.Stop();
  closer_.OnJobCancelled();
  EXPECT_FALSE(closer_.NextJob()) << "nobody would apply it";
  EXPECT_FALSE(closer_.is_busy());
  Grant(kMapper, owner_.epoch() + 2);  // the robot came back
  SendInEpoch(owner_.epoch() + 2);
  ExpectNothingProposedThenClosed();
}

TEST_F(LoopCloserTest, ACorrectionThatIsStoppedComesToNothing) {
  ASSERT_TRUE(FindLoop());
  auto job = closer_.NextJob();
  ASSERT_TRUE(job);
  const std::atomic<bool> stop{true};
  LoopCloser::JobResult result = (*job)(stop);
  EXPECT_FALSE(result.correction.ok());
  closer_.OnJobDone(std::move(result));
  EXPECT_THAT(closer_.closures().front().problem, HasSubstr("interrupted"));
  ExpectNothingProposedThenClosed();
}

/// Wherever in its work it is stopped: it is whole, or there is none.
TEST_F(LoopCloserTest, AStoppedCorrectionIsWholeOrNone) {
  ASSERT_TRUE(FindLoop());
  const auto job = closer_.NextJob();
  ASSERT_TRUE(job);
  LoopCloser::Job whole_job = *job;
  const LoopCloser::JobResult whole = whole_job(kGoOn);
  ASSERT_TRUE(whole.correction.ok());
  for (int attempt = 0; attempt < 5; ++attempt) {
    CorrectionAtWork work(*job);
    const LoopCloser::JobResult stopped = work.Stop();
    if (!stopped.correction) {
      EXPECT_THAT(stopped.correction.error().message, HasSubstr("interrupted"));
      continue;
    }
    Map by_whole = owner_, by_stopped = owner_;
    ASSERT_TRUE(ApplyMapCorrection(*whole.correction, &by_whole).ok());
    ASSERT_TRUE(ApplyMapCorrection(*stopped.correction, &by_stopped).ok());
    EXPECT_EQ(HashMap(by_whole), HashMap(by_stopped));
  }
}

TEST_F(LoopCloserTest, KeyFramesOfNoMapAreAnsweredFor) {
  MapperState first;  // of a pair that is to begin a map
  first.process = ProcessId(0, 1, 1);
  first.map = MapId(0, 9, 9);
  first.last_keyframe = KeyFrameId(0, 9, 9);
  closer_.OnMapperState(first);
  closer_.Update();
  EXPECT_EQ(closer_.last_keyframe(), first.last_keyframe);
  EXPECT_EQ(closer_.last_map(), first.map);
  EXPECT_FALSE(closer_.is_busy());
}

TEST_F(LoopCloserTest, AnotherRobotsMapIsLeftToItsLoopCloser) {
  Command grant;
  grant.kind = CommandKind::kGrantOwnership;
  grant.map = owner_.id();
  grant.epoch = owner_.epoch();
  grant.owner = ProcessId(5, 1, 1);
  closer_.OnCommand(grant);
  state_.process = grant.owner;
  state_.map = owner_.id();
  state_.epoch = owner_.epoch();
  state_.revision = owner_.revision();
  for (const SyntheticView& view : passes_.second.views) {
    state_.last_keyframe = view.data->id;
    closer_.OnMapperState(state_);
    while (closer_.Update()) {
    }
    EXPECT_EQ(closer_.last_keyframe(), view.data->id) << "the robot's tracker need not wait";
  }
  state_.last_keyframe = KeyFrameId(5, 1, 1);
  closer_.OnMapperState(state_);
  EXPECT_EQ(closer_.last_keyframe(), state_.last_keyframe)
      << "another tracker in this map waits for all that follow it";
  state_.map = MapId(5, 1, 7);
  state_.last_keyframe = KeyFrameId(5, 1, 2);
  closer_.OnMapperState(state_);
  EXPECT_NE(closer_.last_keyframe(), state_.last_keyframe) << "of a map that is not followed here";
  EXPECT_EQ(closer_.counters().looked_at, 0u);
  Command adjust;
  adjust.kind = CommandKind::kAdjustMap;
  adjust.map = owner_.id();
  closer_.OnCommand(adjust);
  EXPECT_FALSE(closer_.NextJob());
}

TEST_F(LoopCloserTest, AdjustsAMapWhenAsked) {
  Acknowledge(passes_.second.views[0].data->id);
  EXPECT_FALSE(closer_.NextJob());
  Command adjust;
  adjust.kind = CommandKind::kAdjustMap;
  adjust.map = owner_.id();
  closer_.OnCommand(adjust);
  EXPECT_EQ(RunJob(), JobKind::kGlobalBundleAdjustment);
  if (const auto global = closer_.TakeCorrection()) Answer(*global);
  EXPECT_FALSE(closer_.NextJob()) << "once";
  adjust.map = MapId(9, 9, 9);
  closer_.OnCommand(adjust);
  EXPECT_FALSE(closer_.NextJob());
}

/// The map that is followed was taken into another one of the robot's mapper.
TEST_F(LoopCloserTest, GoesOnInTheMapThatTookItsMapIn) {
  ASSERT_TRUE(FindLoop());
  ASSERT_EQ(RunJob(), JobKind::kLoop);
  ASSERT_TRUE(closer_.TakeCorrection());
  const Map fused(owner_);
  Command command;
  command.kind = CommandKind::kFuseMaps;
  command.map = MapId(0, 9, 9);
  command.other = owner_.id();
  state_.map = command.map;
  state_.epoch = 4;
  state_.revision = 8;
  closer_.OnMapperState(state_);
  closer_.OnCommand(command);
  EXPECT_FALSE(closer_.AwaitsAnswer()) << "nobody will answer for a map that is no more";
  EXPECT_FALSE(closer_.closures().front().is_applied);
  EXPECT_FALSE(closer_.follower().IsFollowed(owner_.id()));
  EXPECT_FALSE(closer_.NextJob()) << "global BA waits for the map";

  MapDelta snapshot = fused.Snapshot();
  snapshot.map = command.map;
  snapshot.epoch = 4;
  snapshot.revision = 8;
  for (const MapDeltaChunk& chunk : SplitDelta(snapshot, 1000)) closer_.follower().AddChunk(chunk);
  while (closer_.Update()) {
  }
  auto job = closer_.NextJob();
  ASSERT_TRUE(job);
  const LoopCloser::JobResult result = (*job)(kGoOn);
  EXPECT_EQ(result.kind, JobKind::kGlobalBundleAdjustment);
  EXPECT_EQ(result.map, command.map);
}

TEST_F(LoopCloserTest, ADeletedMapIsForgotten) {
  ASSERT_TRUE(FindLoop());
  ASSERT_TRUE(closer_.NextJob());
  Command command;
  command.kind = CommandKind::kForgetMap;
  command.map = owner_.id();
  closer_.OnCommand(command);
  EXPECT_TRUE(closer_.ShouldCancel());
  closer_.OnJobCancelled();
  EXPECT_FALSE(closer_.NextJob());
  EXPECT_TRUE(closer_.follower().Maps().empty());
  EXPECT_EQ(closer_.follower().index().size(), 0u);
  Acknowledge(passes_.second.views[next_view_ + 1].data->id);
  EXPECT_FALSE(closer_.NextJob());
  EXPECT_FALSE(closer_.is_busy()) << "what still comes of it is answered for";
}

class OverloadedLoopCloserTest : public LoopCloserTest {
 protected:
  static LoopOptions Few() {
    LoopOptions options = Options();
    options.max_waiting = 2;
    return options;
  }
  OverloadedLoopCloserTest() : LoopCloserTest(Few()) {}
};

TEST_F(OverloadedLoopCloserTest, PassesOverTheOldestKeyFrames) {
  for (size_t view = 0; view < 5; ++view) {
    state_.process = ProcessId(0, 1, 1);
    state_.map = owner_.id();
    state_.revision = owner_.revision();
    state_.last_keyframe = passes_.second.views[view].data->id;
    closer_.OnMapperState(state_);
  }
  EXPECT_EQ(closer_.counters().passed_over, 3u);
  while (closer_.Update()) {
  }
  EXPECT_EQ(closer_.counters().looked_at, 2u);
  EXPECT_EQ(closer_.last_keyframe(), state_.last_keyframe);
}

class ForwardLoopCloserTest : public LoopCloserTest {
 protected:
  static LoopOptions Forward() {
    LoopOptions options = Options();
    options.forward_every_keyframes = 5;
    options.detector.min_keyframes = 100000;  // no loops
    return options;
  }
  ForwardLoopCloserTest() : LoopCloserTest(Forward()) {}
};

TEST_F(ForwardLoopCloserTest, AdjustsForwardWhenIdle) {
  for (size_t view = 0; view < 4; ++view) Acknowledge(passes_.second.views[view].data->id);
  EXPECT_FALSE(closer_.NextJob());
  Acknowledge(passes_.second.views[4].data->id);
  EXPECT_EQ(RunJob(), JobKind::kForwardBundleAdjustment);
  EXPECT_FALSE(closer_.NextJob()) << "not before further keyframes";
  const LoopJobCounters& forward = closer_.counters().of(JobKind::kForwardBundleAdjustment);
  EXPECT_EQ(forward.tried, 1u);
  EXPECT_TRUE(forward.losses);
  EXPECT_EQ(forward.fruitless, closer_.TakeCorrection() ? 0u : 1u);
}

/// What came last need not be in the map: it was refused, pruned since, or is of another map.
TEST_F(ForwardLoopCloserTest, StartsFromTheNewestKeyFrameOfItsMap) {
  for (size_t view = 0; view < 5; ++view) Acknowledge(passes_.second.views[view].data->id);
  Acknowledge(KeyFrameId(0, 77, 1));  // refused
  owner_.RemoveKeyFrame(passes_.second.views[4].data->id);
  SendDelta();
  closer_.Update();
  auto job = closer_.NextJob();
  ASSERT_TRUE(job);
  const LoopCloser::JobResult result = (*job)(kGoOn);
  ASSERT_EQ(result.kind, JobKind::kForwardBundleAdjustment);
  const std::string reason = result.correction ? "" : result.correction.error().message;
  EXPECT_THAT(reason, Not(HasSubstr("is not in the map")));
}

class EagerForwardLoopCloserTest : public LoopCloserTest {
 protected:
  static LoopOptions Eager() {
    LoopOptions options = Options();
    options.forward_every_keyframes = 2;
    return options;
  }
  EagerForwardLoopCloserTest() : LoopCloserTest(Eager()) {}
};

TEST_F(EagerForwardLoopCloserTest, EndsForALoopAndIsDueAgain) {
  Acknowledge(passes_.second.views[next_view_++].data->id);
  Acknowledge(passes_.second.views[next_view_++].data->id);
  ASSERT_TRUE(closer_.NextJob());
  EXPECT_FALSE(closer_.ShouldCancel());
  ASSERT_TRUE(FindLoop());
  EXPECT_TRUE(closer_.ShouldCancel());
  closer_.OnJobCancelled();
  EXPECT_EQ(closer_.counters().of(JobKind::kForwardBundleAdjustment).cancelled, 1u);
  ASSERT_EQ(RunJob(), JobKind::kLoop);
  Refuse(*closer_.TakeCorrection());
  EXPECT_EQ(RunJob(), JobKind::kForwardBundleAdjustment) << "the interval is not used up";
}

}  // namespace
}  // namespace portolan
