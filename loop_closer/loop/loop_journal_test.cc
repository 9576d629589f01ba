#include "loop/loop_journal.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <spdlog/sinks/ostream_sink.h>

#include <sstream>

#include "loop/loop_test_scene.h"

namespace portolan {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

/// The log's lines, "level text", while it lives.
class HeardLog {
 public:
  HeardLog() : before_(spdlog::default_logger()) {
    auto sink = std::make_shared<spdlog::sinks::ostream_sink_st>(text_);
    sink->set_pattern("%l %v");
    auto logger = std::make_shared<spdlog::logger>("heard", sink);
    logger->set_level(spdlog::level::debug);
    spdlog::set_default_logger(std::move(logger));
  }
  ~HeardLog() { spdlog::set_default_logger(before_); }
  std::string Text() const { return text_.str(); }

 private:
  std::shared_ptr<spdlog::logger> before_;
  std::ostringstream text_;
};

class LoopJournalTest : public ::testing::Test {
 protected:
  KeyFrameId First(size_t view) const { return passes_.first.views[view].data->id; }
  KeyFrameId Second(size_t view) const { return passes_.second.views[view].data->id; }
  LoopDetection Refused(std::vector<RefusalKind> kinds) const {
    LoopDetection detection;
    for (const RefusalKind kind : kinds) {
      detection.candidates.push_back({First(detection.candidates.size()), 0.125, 0.75});
      detection.refusals.push_back(
          {Second(0), detection.candidates.back().keyframe, {}, {}, kind, std::string("because it is ") + Name(kind)});
    }
    return detection;
  }
  DetectedLoop Loop() const {
    DetectedLoop loop{Second(0), First(0), {}, LoopDrift()};
    loop.place.inliers = 77;
    loop.place.group_inliers = 211;
    return loop;
  }

  const TwoPasses passes_ = MakeTwoPasses(PlaceSceneOptions());
  const Map map_ = MapWithLoop(passes_);
  LoopJournal journal_;
  HeardLog log_;
};

TEST_F(LoopJournalTest, CandidatesAreToldWithTheirScoresAndRefusalsWithTheirReasons) {
  journal_.NoteDetection(map_, Second(0), Refused({RefusalKind::kInconsistent, RefusalKind::kDrift}));
  const std::string text = log_.Text();
  EXPECT_THAT(text, HasSubstr("debug loop: " + ToString(Second(0))));
  EXPECT_THAT(text, HasSubstr(ToString(First(1)) + " 0.1250 (accumulated 0.7500)"));
  EXPECT_THAT(text, HasSubstr("because it is inconsistent"));
  EXPECT_THAT(text, HasSubstr("info loop: " + ToString(Second(0))));
  EXPECT_THAT(text, HasSubstr("because it is drift"));
}

TEST_F(LoopJournalTest, RefusalsAreCountedByKindAndThoseThatWereVerifiedKept) {
  using Kind = RefusalKind;
  journal_.NoteDetection(map_, Second(0), Refused({Kind::kInconsistent, Kind::kInconsistent, Kind::kSurplus}));
  EXPECT_EQ(journal_.counters().refused, 0u);
  journal_.NoteDetection(map_, Second(0), Refused({Kind::kNotVerified, Kind::kAmbiguous}));
  EXPECT_EQ(journal_.counters().candidates, 5u);
  EXPECT_EQ(journal_.counters().refused, 2u);
  EXPECT_EQ(journal_.counters().refusals_of(Kind::kInconsistent), 2u);
  EXPECT_EQ(journal_.counters().refusals_of(Kind::kSurplus), 1u);
  EXPECT_EQ(journal_.counters().refusals_of(Kind::kNotVerified), 1u);
  ASSERT_EQ(journal_.refusals().size(), 2u);
  EXPECT_EQ(journal_.refusals().back().kind, Kind::kAmbiguous);
}

TEST_F(LoopJournalTest, OneThatWaitsForAnotherToSayTheSameIsToldSo) {
  LoopDetection detection;
  detection.confirmed = Loop();
  journal_.NoteDetection(map_, Second(0), detection);
  EXPECT_THAT(log_.Text(), HasSubstr("waits for another keyframe"));
  journal_.NoteDetection(map_, Second(0), Refused({RefusalKind::kContradicted}));
  detection.loop = Loop();
  const size_t told = log_.Text().size();
  journal_.NoteDetection(map_, Second(0), detection);
  EXPECT_THAT(log_.Text().substr(told), Not(HasSubstr("waits")));
}

TEST_F(LoopJournalTest, AClosureIsToldWithItsSimilarityAndTheTimesOfItsSteps) {
  StageTimes detected, corrected;
  detected.Add("verify", 10);
  detected.Add("verify", 20);  // of two candidates
  const size_t closure = journal_.OpenClosure(map_, Loop(), detected);
  corrected.Add("loop_graph", 40);
  journal_.AddTimes(closure, corrected);
  journal_.NoteApplied(closure, 250);
  const std::string text = log_.Text();
  EXPECT_THAT(text, HasSubstr("info loop: " + ToString(Second(0)) + " is closed with " + ToString(First(0))));
  EXPECT_THAT(text, HasSubstr("scale 1.200, turned by 4.01 deg, moved by (0.300, -0.200, 0.300)"));  // 0.07 rad
  EXPECT_THAT(text, HasSubstr("77 inliers, 211 landmarks; applied 250.0 ms, loop_graph 40.0 ms, verify 30.0 ms"));
}

TEST_F(LoopJournalTest, AClosureThatSeemedToFailMayBeAppliedAfterAll) {
  const size_t closure = journal_.OpenClosure(map_, Loop(), StageTimes());
  journal_.NoteFailed(closure, "no answer");
  EXPECT_EQ(journal_.counters().failed, 1u);
  journal_.NoteApplied(closure, 1);
  EXPECT_EQ(journal_.counters().failed, 0u);
  EXPECT_EQ(journal_.counters().closed, 1u);
  EXPECT_TRUE(journal_.closures()[closure].is_applied);
  EXPECT_EQ(journal_.closures()[closure].problem, "");
}

TEST_F(LoopJournalTest, JobsAreCountedByHowTheyEndAndTheLossesTold) {
  constexpr LoopJobKind kKind = LoopJobKind::kForwardBundleAdjustment;
  for (int k = 0; k < 3; ++k) journal_.NoteTried(kKind);
  journal_.NoteFruitless(kKind, map_.id(), "no better");
  journal_.NoteLosses(kKind, {0.05, 0.04});
  journal_.NoteProposed(kKind, map_.id());
  journal_.NoteUnanswered(kKind, "no answer");
  journal_.NoteAnswered(kKind, map_.id(), "", true);
  journal_.NoteAnswered(kKind, map_.id(), "does not fit", false);
  const LoopJobCounters& counters = journal_.counters().of(kKind);
  EXPECT_EQ(counters.tried, 3u);
  EXPECT_EQ(counters.fruitless, 1u);
  EXPECT_EQ(counters.applied, 1u);
  EXPECT_EQ(counters.refused, 1u);
  EXPECT_EQ(counters.unanswered, 0u);
  EXPECT_THAT(log_.Text(), HasSubstr("mean reprojection loss 0.04000, without it 0.05000"));
}

}  // namespace
}  // namespace portolan
