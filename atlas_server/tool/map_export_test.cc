#include "tool/map_export.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstring>
#include <fstream>
#include <sstream>

#include "dataset/temp_folder.h"
#include "dataset/trajectory_io.h"
#include "map/random_edits.h"

namespace portolan {
namespace {

using ::testing::HasSubstr;

class MapExportTest : public ::testing::Test {
 protected:
  MapExportTest() : map_(MapId(0, 1, 1), 1) {
    RandomEdits edits(5, &map_);
    for (int i = 0; i < 200; ++i) edits.Next();
    static_cast<void>(map_.TakeDelta());
  }
  TempFolder folder_;
  Map map_;
};

TEST_F(MapExportTest, PlyHasAllPointsAndCameras) {
  const std::string path = folder_.Path("map.ply");
  ASSERT_TRUE(WriteMapPly(path, map_).ok());
  std::ostringstream content;
  content << std::ifstream(path, std::ios::binary).rdbuf();
  const std::string file = content.str(), end = "end_header\n";
  const size_t vertices = map_.points().size() + map_.keyframes().size();
  EXPECT_THAT(file, HasSubstr("element vertex " + std::to_string(vertices) + "\n"));
  const size_t data = file.find(end) + end.size();
  ASSERT_EQ(file.size() - data, vertices * (3 * sizeof(float) + 3));
  float first[3];
  std::memcpy(first, file.data() + data, sizeof first);
  const Eigen::Vector3f expected = map_.point(map_.SortedPointIds()[0]).position_in_map;
  EXPECT_EQ(Eigen::Vector3f(first[0], first[1], first[2]), expected);
}

TEST_F(MapExportTest, TrajectoryHasTheKeyFramesInTheOrderOfTime) {
  const std::string path = folder_.Path("keyframes.txt");
  ASSERT_TRUE(WriteKeyFrameTrajectory(path, map_).ok());
  std::ifstream file(path);
  std::string line;
  double before = -1e18;
  size_t lines = 0;
  while (std::getline(file, line)) {
    const double stamp = std::stod(line);
    EXPECT_GE(stamp, before);
    before = stamp;
    ++lines;
  }
  EXPECT_EQ(lines, map_.keyframes().size());
}

TEST_F(MapExportTest, AFolderThatIsNotThereIsAnError) {
  EXPECT_FALSE(WriteMapPly(folder_.Path("none/map.ply"), map_).ok());
  EXPECT_FALSE(WriteKeyFrameTrajectory(folder_.Path("none/map.txt"), map_).ok());
}

}  // namespace
}  // namespace portolan
