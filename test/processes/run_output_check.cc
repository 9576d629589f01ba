#include "processes/run_output_check.h"

#include <gtest/gtest.h>

#include "dataset/trajectory_evaluation.h"
#include "processes/process_test.h"

namespace portolan {
namespace {

constexpr size_t kPlyVertexBytes = 15;  // three floats and a colour of three bytes, as run_output.cc writes them

double LengthOf(const Trajectory& trajectory) {
  double length = 0;
  for (size_t i = 1; i < trajectory.size(); ++i) {
    length += (trajectory[i].world_from_camera.translation - trajectory[i - 1].world_from_camera.translation).norm();
  }
  return length;
}

}  // namespace

void ExpectWholeOutput(const std::string& folder) {
  const Trajectory joined = ExpectTrajectory(folder + "/trajectory.txt");
  EXPECT_GT(joined.size(), 0u);
  EXPECT_EQ(ExpectTrajectory(folder + "/trajectory_maps.txt").size(), joined.size());
  EXPECT_GT(ExpectTrajectory(folder + "/trajectory_online.txt").size(), 0u);
  const nlohmann::json summary = ReadReport(folder + "/summary.json");
  ExpectSummaryKeys(summary);
  EXPECT_EQ(summary["tracked"], joined.size());
  EXPECT_EQ(summary["keyframes"], ExpectTrajectory(folder + "/keyframes.txt").size());
  EXPECT_EQ(summary["points"], ExpectWholePly(folder + "/map.ply"));
  for (const char* role : {"frontend_tracker", "backend_mapper", "loop_closer", "atlas_server"}) {
    EXPECT_NE(ReadWholeFile(folder + "/logs/" + role + ".log"), "") << role;
  }
}

void ExpectSummaryKeys(const nlohmann::json& summary) {
  for (const char* key :
       {"frames", "tracked", "dropped", "maps", "keyframes", "points", "loops", "switches", "fusions"}) {
    ASSERT_TRUE(summary.contains(key) && summary[key].is_number_integer()) << key << " in " << summary;
  }
  for (const char* key : {"median", "p95"}) EXPECT_GT(summary["frame_ms"].value(key, 0.0), 0) << key;
  for (const char* topic :
       {"keyframe", "map_delta", "tracker_state", "mapper_state", "process_status", "command", "request", "reply"}) {
    EXPECT_GT(summary["bytes_sent"].value(topic, 0), 0) << topic;
  }
  for (const char* role : {"frontend_tracker", "backend_mapper", "loop_closer", "atlas_server"}) {
    EXPECT_GT(summary["peak_memory_mb"].value(role, 0.0), 0) << role;
    EXPECT_GT(summary["cpu_s"].value(role, 0.0), 0) << role;
    EXPECT_TRUE(summary["stages_ms"].contains(role)) << role;
    EXPECT_NE(summary["build"].value(role, ""), "") << role;
  }
}

size_t ExpectWholePly(const std::string& path) {
  const std::string file = ReadWholeFile(path);
  const std::string end = "end_header\n", element = "element vertex ";
  const size_t header = file.find(end), count_at = file.find(element);
  EXPECT_EQ(file.rfind("ply\n", 0), 0u) << path;
  EXPECT_NE(header, std::string::npos) << path;
  EXPECT_LT(count_at, header) << path;
  if (header == std::string::npos || count_at == std::string::npos) return 0;
  const size_t count = std::stoul(file.substr(count_at + element.size()));
  EXPECT_EQ(file.size(), header + end.size() + count * kPlyVertexBytes) << path;
  return count;
}

Trajectory ExpectTrajectory(const std::string& path) {
  Result<Trajectory> trajectory = ReadTrajectory(path);
  EXPECT_TRUE(trajectory.ok()) << (trajectory.ok() ? "" : trajectory.error().message);
  return trajectory.ok() ? std::move(trajectory).value() : Trajectory();
}

void ExpectAccurate(const std::string& truth_file, const std::string& trajectory_file, double max_share) {
  const Trajectory truth = ExpectTrajectory(truth_file);
  const Result<Evaluation> evaluation = EvaluateTrajectory(truth, ExpectTrajectory(trajectory_file), {});
  ASSERT_TRUE(evaluation.ok()) << evaluation.error().message;
  ASSERT_TRUE(evaluation->joined.truth_from_map) << evaluation->joined.failure;
  EXPECT_LT(evaluation->joined.ate.rmse, max_share * LengthOf(truth));
}

void ExpectSameMaps(const nlohmann::json& atlas_server, const nlohmann::json& loop_closer) {
  const nlohmann::json hashes = atlas_server.value("map_hash", nlohmann::json::object());
  EXPECT_FALSE(hashes.empty());
  EXPECT_EQ(hashes, loop_closer.value("map_hash", nlohmann::json::object()));
}

}  // namespace portolan
