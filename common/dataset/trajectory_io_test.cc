#include "dataset/trajectory_io.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "base/flat_yaml.h"
#include "base/random.h"
#include "dataset/frame_times.h"
#include "dataset/temp_folder.h"

namespace portolan {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

Rigid3d RandomPose(Random* random) {
  const Eigen::Vector3d axis(random->Gaussian(), random->Gaussian(), random->Gaussian());
  const Eigen::Vector3d translation(random->Gaussian(), random->Gaussian(), random->Gaussian());
  return Rigid3d(ExpSO3(axis.normalized() * random->Uniform(0, 3)), 100 * translation);
}

Trajectory RandomTrajectory(int size) {
  Random random(11);
  Trajectory trajectory;
  for (int i = 0; i < size; ++i)
    trajectory.push_back({Timestamp{1403636579763555527 + i * 50000001LL}, RandomPose(&random), i / 5});
  return trajectory;
}

void ExpectNear(const Rigid3d& a, const Rigid3d& b, double tolerance) {
  EXPECT_LT((a.translation - b.translation).norm(), tolerance);
  EXPECT_LT(a.rotation.angularDistance(b.rotation), tolerance);
}

class TrajectoryIoTest : public testing::Test {
 protected:
  std::string FailureOf(const std::string& text, const std::string& times = "") {
    const auto trajectory = ReadTrajectory(folder_.Write("t.txt", text), times);
    if (trajectory) return "no failure";
    const std::string path = folder_.Path("t.txt");
    return trajectory.error().message.compare(0, path.size(), path) == 0
               ? trajectory.error().message.substr(path.size())
               : trajectory.error().message;
  }
  const TempFolder folder_;
};

TEST_F(TrajectoryIoTest, ReadsWhatItWrites) {
  const Trajectory trajectory = RandomTrajectory(20);
  for (const bool with_map : {false, true}) {
    ASSERT_TRUE(WriteTrajectory(folder_.Path("t.txt"), trajectory, with_map));
    const auto read = ReadTrajectory(folder_.Path("t.txt"));
    ASSERT_TRUE(read) << read.error().message;
    ASSERT_EQ(read->size(), trajectory.size());
    for (size_t i = 0; i < trajectory.size(); ++i) {
      EXPECT_EQ((*read)[i].stamp, trajectory[i].stamp) << "exact to the nanosecond";
      EXPECT_EQ((*read)[i].map, with_map ? trajectory[i].map : 0);
      ExpectNear((*read)[i].world_from_camera, trajectory[i].world_from_camera,
                 1e-7);  // nine decimals; acos near 1 halves them
    }
  }
}

TEST_F(TrajectoryIoTest, WritesTumLines) {
  const Trajectory trajectory{{Timestamp{1500000000}, Rigid3d(Eigen::Quaterniond::Identity(), {1, -2, 0.5}), 3}};
  ASSERT_TRUE(WriteTrajectory(folder_.Path("t.txt"), trajectory, true));
  EXPECT_EQ(*ReadTextFile(folder_.Path("t.txt")),
            "1.500000000 1.000000000 -2.000000000 0.500000000 0.000000000 0.000000000 0.000000000 1.000000000 3\n");
}

TEST_F(TrajectoryIoTest, WritingIntoNowhereFails) {
  EXPECT_THAT(WriteTrajectory(folder_.Path("none/t.txt"), {}, false).error().message,
              HasSubstr("can't be written: No such file or directory"));
}

TEST_F(TrajectoryIoTest, ReadsKittiWithAndWithoutTimes) {
  // The second pose: a quarter turn about y and a step along z.
  const std::string poses = folder_.Write("poses.txt", "1 0 0 0 0 1 0 0 0 0 1 0\n0 0 1 5 0 1 0 6 -1 0 0 7\n");
  const auto numbered = ReadTrajectory(poses);
  ASSERT_TRUE(numbered) << numbered.error().message;
  EXPECT_EQ((*numbered)[1].stamp.ns, 1000000000);
  ExpectNear((*numbered)[1].world_from_camera, Rigid3d(ExpSO3({0, M_PI / 2, 0}), {5, 6, 7}), 1e-7);
  const auto timed = ReadTrajectory(poses, folder_.Write("times.txt", "0.5\n0.75\n"));
  ASSERT_TRUE(timed) << timed.error().message;
  EXPECT_EQ((*timed)[1].stamp.ns, 750000000);
  EXPECT_THAT(ReadTrajectory(poses, folder_.Write("times.txt", "0.5\n")).error().message,
              HasSubstr("times.txt: has 1 times for the 2 poses of "));
  EXPECT_THAT(ReadTrajectory(poses, folder_.Write("times.txt", "0.5\nx\n")).error().message,
              HasSubstr("times.txt:2: expected one time in seconds"));
  EXPECT_THAT(ReadTrajectory(poses, folder_.Write("times.txt", "2\n1\n")).error().message,
              HasSubstr("times must rise"));
}

TEST_F(TrajectoryIoTest, ReadsEurocGroundTruthOfTheBodyAsTheCameras) {
  const std::string rest = ",0,0,0,0,0,0,0,0,0\n";
  const std::string path = folder_.Write("mav0/state_groundtruth_estimate0/data.csv",
                                         "#timestamp, p_RS_R_x [m], ...\n1403636580838555648,1,2,3,1,0,0,0" + rest +
                                             "1403636580843555328,1,2,3,0.70710678,0,0,0.70710678" + rest);
  const auto body = ReadTrajectory(path);
  ASSERT_TRUE(body) << body.error().message;
  EXPECT_EQ((*body)[0].stamp.ns, 1403636580838555648);
  ExpectNear((*body)[0].world_from_camera, Rigid3d(Eigen::Quaterniond::Identity(), {1, 2, 3}), 1e-7);
  folder_.Write("mav0/cam0/sensor.yaml",
                "T_BS:\n  cols: 4\n  rows: 4\n  data: [0, -1, 0, 0.1,  1, 0, 0, 0.2,  0, 0, 1, 0.3,  0, 0, 0, 1]\n");
  const auto camera = ReadTrajectory(path);
  ASSERT_TRUE(camera) << camera.error().message;
  const Rigid3d body_from_camera(ExpSO3({0, 0, M_PI / 2}), {0.1, 0.2, 0.3});
  for (size_t i = 0; i < 2; ++i)
    ExpectNear((*camera)[i].world_from_camera, (*body)[i].world_from_camera * body_from_camera, 1e-7);
  folder_.Write("mav0/cam0/sensor.yaml", "T_BS:\n  data: [1, 2, 3]\n");
  EXPECT_THAT(ReadTrajectory(path).error().message,
              HasSubstr("sensor.yaml:2: T_BS.data: expected a list of 16 finite numbers"));
}

TEST_F(TrajectoryIoTest, NamesTheLineOfWhatIsWrong) {
  const std::string good = "1 0 0 0 0 0 0 1\n";
  EXPECT_THAT(FailureOf(good + "2 0 0 x 0 0 0 1\n"), HasSubstr(":2: expected 'seconds tx ty tz qx qy qz qw [map]'"));
  EXPECT_THAT(FailureOf(good + "2 0 0 nan 0 0 0 1\n"), HasSubstr(":2: expected"));
  EXPECT_THAT(FailureOf(good + "2 0 0 0 0 0 0 0\n"), HasSubstr("with a unit quaternion, found '2 0 0 0 0 0 0 0'"));
  EXPECT_THAT(FailureOf(good + "2 0 0 0 0 0 0 1.1\n"), HasSubstr(":2: expected"));
  EXPECT_THAT(FailureOf(good + "2 0 0 0 0 0 0 1 0\n"), HasSubstr(":2: expected 8 columns as in line 1"));
  EXPECT_THAT(FailureOf("1 0 0 0 0 0 0 1 -1\n"), HasSubstr(":1: expected"));
  EXPECT_THAT(FailureOf("1 2 3\n"),
              HasSubstr(":1: expected 8 or 9 columns (TUM), 12 (KITTI) or 17 (EuRoC ground truth)"));
  EXPECT_THAT(FailureOf("1 0 0 0 0 1 0 0 0 0 2 0\n"),
              HasSubstr(":1: expected 12 finite numbers, the rows of [R t] with R a rotation"));
  EXPECT_THAT(FailureOf("1 0 0 0 0 1 0 0 0 0 -1 0\n"), HasSubstr("with R a rotation")) << "a mirror image";
  EXPECT_THAT(ReadTrajectory("/nowhere/t.txt").error().message, HasSubstr("/nowhere/t.txt: can't be opened"));
}

TEST_F(TrajectoryIoTest, TimesRiseWithinEachMap) {
  EXPECT_EQ(FailureOf("#\n2 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n"),
            ":3: times must rise, but 1.000000000 s follows 2.000000000 s");
  EXPECT_THAT(FailureOf("1 0 0 0 0 0 0 1 0\n1 0 0 0 0 0 0 1 0\n"), HasSubstr(":2: times must rise"));
  EXPECT_EQ(FailureOf("5 0 0 0 0 0 0 1 0\n1 0 0 0 0 0 0 1 1\n6 0 0 0 0 0 0 1 0\n"), "no failure");
}

TEST_F(TrajectoryIoTest, RoundedQuaternionsAreNormalised) {
  const auto read = ReadTrajectory(folder_.Write("t.txt", "1 0 0 0 0 0 0.7071 0.7071\n"));
  ASSERT_TRUE(read);
  EXPECT_NEAR((*read)[0].world_from_camera.rotation.norm(), 1, 1e-15);
}

TEST_F(TrajectoryIoTest, AFileWithoutLinesIsAnEmptyTrajectory) {
  EXPECT_TRUE(ReadTrajectory(folder_.Write("t.txt", "# head\n"))->empty());
}

TEST_F(TrajectoryIoTest, FindsAndReadsTheFramesBesideTheGroundTruth) {
  const std::string truth = folder_.Write("groundtruth.txt", "");
  EXPECT_EQ(FindFrameTimes(truth), "");
  folder_.Write("rgb.txt", "# t file\n0.5 a.png\n0.75 b.png\n");
  const auto times = ReadFrameTimes(FindFrameTimes(truth));
  ASSERT_TRUE(times) << times.error().message;
  EXPECT_THAT(*times, ElementsAre(Timestamp{500000000}, Timestamp{750000000}));
  folder_.Write("mav0/cam0/data.csv", "#t,f\n7,7.png\n9,9.png\n");
  const auto nanoseconds =
      ReadFrameTimes(FindFrameTimes(folder_.Write("mav0/state_groundtruth_estimate0/data.csv", "")));
  ASSERT_TRUE(nanoseconds) << nanoseconds.error().message;
  EXPECT_THAT(*nanoseconds, ElementsAre(Timestamp{7}, Timestamp{9}));
  EXPECT_THAT(ReadFrameTimes(folder_.Write("times.txt", "1\n1\n")).error().message,
              HasSubstr("times.txt:2: expected rising times in seconds, found '1'"));
}

TEST_F(TrajectoryIoTest, ReadsTheSharedGroundTruth) {
  const std::string data = SharedDataFolder();
  if (data.empty()) GTEST_SKIP() << "no shared/data beside the repository and PORTOLAN_DATA is not set";
  for (const char* name : {"kitchen", "halls", "office_walk", "blackout"}) {
    const auto truth = ReadTrajectory(data + "/" + name + "/groundtruth.txt");
    EXPECT_TRUE(truth) << truth.error().message;
  }
  const auto kitti = ReadTrajectory(data + "/kitti_00/poses.txt", data + "/kitti_00/times.txt");
  ASSERT_TRUE(kitti) << kitti.error().message;
  EXPECT_EQ(kitti->size(), 300u);
  double length = 0;
  for (size_t i = 1; i < kitti->size(); ++i) {
    length += ((*kitti)[i].world_from_camera.translation - (*kitti)[i - 1].world_from_camera.translation).norm();
  }
  EXPECT_NEAR(length, 216, 1) << "metres, as the README says";
}

}  // namespace
}  // namespace portolan
