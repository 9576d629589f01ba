#include "process/loop_report.h"

#include <gtest/gtest.h>

#include <map>

#include "testing/map_builder.h"

namespace portolan {
namespace {

class LoopReportTest : public ::testing::Test {
 protected:
  KeyFrameId id(size_t view) const { return scene_.views[view].data->id; }
  std::map<std::string, double> Figures() const {
    const auto figures = LoopFigures(journal_);
    return {figures.begin(), figures.end()};
  }
  nlohmann::json Report() const {
    nlohmann::json report;
    AddLoops(journal_, &report);
    return report;
  }
  DetectedLoop Loop(double scale, int inliers) const {
    DetectedLoop loop{id(5), id(0), {}, Sim3d(scale, Eigen::Quaterniond::Identity(), {0, 0, 0})};
    loop.place.inliers = inliers;
    return loop;
  }
  const SyntheticScene scene_ = MakeSyntheticScene(SyntheticSceneOptions());
  const Map map_ = BuildMap(scene_);
  LoopJournal journal_;
};

TEST_F(LoopReportTest, FiguresTellOfTheLastLoopThatWasClosed) {
  EXPECT_EQ(Figures().count("last_loop_scale"), 0u);
  journal_.NoteApplied(journal_.OpenClosure(map_, Loop(0.9, 50), StageTimes()), 1500);
  journal_.NoteFailed(journal_.OpenClosure(map_, Loop(2, 30), StageTimes()), "refused");
  const auto figures = Figures();
  EXPECT_EQ(figures.at("loops"), 1);
  EXPECT_EQ(figures.at("loop_failed"), 1);
  EXPECT_EQ(figures.at("last_loop_scale"), 0.9);
  EXPECT_EQ(figures.at("last_loop_inliers"), 50);
  EXPECT_EQ(figures.at("last_loop_s"), 1.5);
}

TEST_F(LoopReportTest, RefusalsHaveTheirStampsAndKinds) {
  LoopDetection detection;
  detection.refusals.push_back({id(5), id(1), Timestamp{50}, Timestamp{10}, RefusalKind::kDrift, "too far"});
  detection.refusals.push_back({id(5), id(2), Timestamp{50}, Timestamp{20}, RefusalKind::kSurplus, "too many"});
  journal_.NoteDetection(map_, id(5), detection);
  const nlohmann::json report = Report();
  ASSERT_EQ(report["refusals"].size(), 1u);
  EXPECT_EQ(report["refusals"][0]["stamp_ns"], 50);
  EXPECT_EQ(report["refusals"][0]["candidate_stamp_ns"], 10);
  EXPECT_EQ(report["refusals"][0]["kind"], "drift");
  EXPECT_EQ(report["refusals"][0]["reason"], "too far");
  EXPECT_EQ(report["loop_counters"]["refused"], 1);
  EXPECT_EQ(report["loop_counters"]["refused_surplus"], 1);
  EXPECT_EQ(Figures().at("loop_refused_drift"), 1);
  EXPECT_EQ(Figures().at("loop_refusals"), 1);
}

TEST_F(LoopReportTest, JobsAreReportedByHowTheyEnded) {
  journal_.NoteTried(LoopJobKind::kForwardBundleAdjustment);
  journal_.NoteLosses(LoopJobKind::kForwardBundleAdjustment, {0.5, 0.25});
  journal_.NoteAnswered(LoopJobKind::kForwardBundleAdjustment, map_.id(), "", false);
  journal_.NoteCancelled(LoopJobKind::kGlobalBundleAdjustment, map_.id());
  journal_.NoteAnswered(LoopJobKind::kGlobalBundleAdjustment, map_.id(), "does not fit", false);
  const nlohmann::json counters = Report()["loop_counters"];
  EXPECT_EQ(counters["forward_ba"], 1);
  EXPECT_EQ(counters["global_ba"], 0);
  EXPECT_EQ(counters["cancelled"], 1);
  EXPECT_EQ(counters["jobs"]["forward_ba"]["tried"], 1);
  EXPECT_EQ(counters["jobs"]["forward_ba"]["loss"], 0.25);
  EXPECT_EQ(counters["jobs"]["forward_ba"]["loss_without"], 0.5);
  EXPECT_EQ(counters["jobs"]["global_ba"]["refused"], 1);
  EXPECT_EQ(counters["jobs"]["global_ba"]["cancelled"], 1);
  EXPECT_EQ(counters["jobs"]["global_ba"].count("loss"), 0u);
}

}  // namespace
}  // namespace portolan
