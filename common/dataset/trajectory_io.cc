#include "dataset/trajectory_io.h"

#include <fmt/format.h>

#include <Eigen/LU>
#include <array>
#include <cmath>
#include <filesystem>
#include <iterator>
#include <map>

#include "base/atomic_file.h"
#include "base/flat_yaml.h"
#include "dataset/calibration_fields.h"
#include "dataset/text_table.h"

namespace portolan {
namespace {

constexpr size_t kTumColumns = 8;
constexpr size_t kTumColumnsWithMap = 9;
constexpr size_t kKittiColumns = 12;
constexpr size_t kEurocColumns = 17;  ///< stamp, position, quaternion, velocity, biases
constexpr size_t kEurocUsed = 8;
/// Files round to four digits at worst; what is further from a unit quaternion or a rotation matrix is something else.
constexpr double kRotationTolerance = 1e-2;

/// Finite numbers of the fields from `first` on; empty if one is none.
std::vector<double> ParseNumbers(const std::vector<std::string>& fields, size_t first, size_t count) {
  std::vector<double> numbers(count);
  for (size_t i = 0; i < count; ++i) {
    if (!ParseNumber(fields[first + i], &numbers[i])) return {};
  }
  return numbers;
}

std::optional<Rigid3d> MakePose(const Eigen::Vector3d& translation, const Eigen::Quaterniond& rotation) {
  if (std::abs(rotation.norm() - 1) > kRotationTolerance) return std::nullopt;
  return Rigid3d(rotation.normalized(), translation);
}

/// From the first three rows of a 4x4 matrix.
std::optional<Rigid3d> MakePose(const std::vector<double>& rows) {
  const auto matrix = Eigen::Map<const Eigen::Matrix<double, 3, 4, Eigen::RowMajor>>(rows.data());
  const Eigen::Matrix3d rotation = matrix.leftCols<3>();
  const double skewness = (rotation * rotation.transpose() - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff();
  if (skewness > kRotationTolerance || rotation.determinant() < 0) return std::nullopt;
  return MakePose(matrix.col(3), Eigen::Quaterniond(rotation).normalized());
}

/// "seconds tx ty tz qx qy qz qw [map]".
std::optional<TrajectoryPose> ParseTum(const std::vector<std::string>& fields) {
  const std::optional<Timestamp> stamp = ParseSeconds(fields[0]);
  const std::vector<double> v = ParseNumbers(fields, 1, 7);
  int64_t map = 0;
  if (fields.size() == kTumColumnsWithMap && (!ParseNumber(fields[8], &map) || map < 0 || map > INT32_MAX))
    return std::nullopt;
  if (!stamp || v.empty()) return std::nullopt;
  const std::optional<Rigid3d> pose = MakePose({v[0], v[1], v[2]}, Eigen::Quaterniond(v[6], v[3], v[4], v[5]));
  if (!pose) return std::nullopt;
  return TrajectoryPose{*stamp, *pose, static_cast<int>(map)};
}

/// "nanoseconds px py pz qw qx qy qz ...": of the body, that is the inertial sensor.
std::optional<TrajectoryPose> ParseEuroc(const std::vector<std::string>& fields) {
  const std::optional<Timestamp> stamp = ParseNanoseconds(fields[0]);
  const std::vector<double> v = ParseNumbers(fields, 1, kEurocUsed - 1);
  if (!stamp || v.empty()) return std::nullopt;
  const std::optional<Rigid3d> pose = MakePose({v[0], v[1], v[2]}, Eigen::Quaterniond(v[3], v[4], v[5], v[6]));
  if (!pose) return std::nullopt;
  return TrajectoryPose{*stamp, *pose, 0};
}

Error BadRow(const std::string& path, const TextRow& row, const std::string& expected) {
  return Error{fmt::format("{}:{}: expected {}, found '{}'", path, row.line, expected, fmt::join(row.fields, " "))};
}

/// Times must rise within each map.
Status CheckTimesRise(const std::string& path, const std::vector<TextRow>& rows, const Trajectory& trajectory) {
  std::map<int, Timestamp> last;
  for (size_t i = 0; i < trajectory.size(); ++i) {
    const TrajectoryPose& pose = trajectory[i];
    const auto [before, first_of_map] = last.emplace(pose.map, pose.stamp);
    if (!first_of_map && pose.stamp <= before->second) {
      return Error{fmt::format("{}:{}: times must rise, but {} s follows {} s", path, rows[i].line,
                               FormatSeconds(pose.stamp), FormatSeconds(before->second))};
    }
    before->second = pose.stamp;
  }
  return Ok{};
}

/// The stamps of KITTI's poses: of the times file, or the frame's number in seconds.
Result<std::vector<Timestamp>> ReadTimes(const std::string& times_file, const std::string& path, size_t num_poses) {
  std::vector<Timestamp> stamps;
  if (times_file.empty()) {
    for (size_t i = 0; i < num_poses; ++i) stamps.push_back(Timestamp::FromSeconds(static_cast<double>(i)));
    return stamps;
  }
  const Result<std::vector<TextRow>> rows = ReadTextTable(times_file);
  if (!rows) return rows.error();
  for (const TextRow& row : *rows) {
    const std::optional<Timestamp> stamp = row.fields.size() == 1 ? ParseSeconds(row.fields[0]) : std::nullopt;
    if (!stamp) return BadRow(times_file, row, "one time in seconds");
    stamps.push_back(*stamp);
  }
  if (stamps.size() == num_poses) return stamps;
  return Error{fmt::format("{}: has {} times for the {} poses of {}", times_file, stamps.size(), num_poses, path)};
}

Result<Trajectory> ReadKitti(const std::string& path, const std::vector<TextRow>& rows, const std::string& times_file) {
  const Result<std::vector<Timestamp>> stamps = ReadTimes(times_file, path, rows.size());
  if (!stamps) return stamps.error();
  Trajectory trajectory;
  for (const TextRow& row : rows) {
    const std::vector<double> numbers = ParseNumbers(row.fields, 0, kKittiColumns);
    const std::optional<Rigid3d> pose = numbers.empty() ? std::nullopt : MakePose(numbers);
    if (!pose) return BadRow(path, row, "12 finite numbers, the rows of [R t] with R a rotation");
    trajectory.push_back({(*stamps)[trajectory.size()], *pose, 0});
  }
  return trajectory;
}

Result<Trajectory> ReadTum(const std::string& path, const std::vector<TextRow>& rows) {
  Trajectory trajectory;
  for (const TextRow& row : rows) {
    const std::optional<TrajectoryPose> pose = ParseTum(row.fields);
    if (!pose) return BadRow(path, row, "'seconds tx ty tz qx qy qz qw [map]' with a unit quaternion");
    trajectory.push_back(*pose);
  }
  return trajectory;
}

/// body_from_camera (T_BS) of mav0/cam0/sensor.yaml beside mav0/state_groundtruth_estimate0/data.csv; identity without
/// that file.
Result<Rigid3d> ReadBodyFromCamera(const std::string& groundtruth) {
  const std::filesystem::path folder = std::filesystem::absolute(groundtruth).parent_path();
  const std::string path = (folder.parent_path() / "cam0" / "sensor.yaml").string();
  if (!std::filesystem::exists(path)) return Rigid3d();
  const Result<std::string> text = ReadTextFile(path);
  if (!text) return text.error();
  const Result<std::vector<YamlEntry>> entries = ParseFlatYaml(*text, path);
  if (!entries) return entries.error();
  CalibrationFields fields(path, *entries);
  const std::optional<Rigid3d> pose = MakePose(fields.Numbers("T_BS.data", {16}));
  if (!pose) fields.AddMistake("T_BS.data", "a rigid transformation");
  if (Status read = fields.Check(); !read) return read.error();
  return *pose;
}

Result<Trajectory> ReadEuroc(const std::string& path, const std::vector<TextRow>& rows) {
  const Result<Rigid3d> body_from_camera = ReadBodyFromCamera(path);
  if (!body_from_camera) return body_from_camera.error();
  Trajectory trajectory;
  for (const TextRow& row : rows) {
    std::optional<TrajectoryPose> pose = ParseEuroc(row.fields);
    if (!pose) return BadRow(path, row, "'nanoseconds px py pz qw qx qy qz ...' with a unit quaternion");
    pose->world_from_camera = pose->world_from_camera * *body_from_camera;
    trajectory.push_back(*pose);
  }
  return trajectory;
}

Result<Trajectory> ParseRows(const std::string& path, const std::vector<TextRow>& rows, const std::string& times_file) {
  const size_t columns = rows[0].fields.size();
  for (const TextRow& row : rows) {
    if (row.fields.size() != columns)
      return BadRow(path, row, fmt::format("{} columns as in line {}", columns, rows[0].line));
  }
  if (columns == kKittiColumns) return ReadKitti(path, rows, times_file);
  if (columns == kEurocColumns) return ReadEuroc(path, rows);
  if (columns == kTumColumns || columns == kTumColumnsWithMap) return ReadTum(path, rows);
  return BadRow(path, rows[0], "8 or 9 columns (TUM), 12 (KITTI) or 17 (EuRoC ground truth)");
}

}  // namespace

Result<Trajectory> ReadTrajectory(const std::string& path, const std::string& times_file) {
  const Result<std::vector<TextRow>> rows = ReadTextTable(path);
  if (!rows) return rows.error();
  if (rows->empty()) return Trajectory{};
  Result<Trajectory> trajectory = ParseRows(path, *rows, times_file);
  if (!trajectory) return trajectory;
  if (Status rises = CheckTimesRise(path, *rows, *trajectory); !rises) return rises.error();
  return trajectory;
}

Status WriteTrajectory(const std::string& path, const Trajectory& trajectory, bool with_map) {
  std::string text;
  for (const TrajectoryPose& pose : trajectory) {
    const Eigen::Vector3d& t = pose.world_from_camera.translation;
    const Eigen::Quaterniond& q = pose.world_from_camera.rotation;
    fmt::format_to(std::back_inserter(text), "{} {:.9f} {:.9f} {:.9f} {:.9f} {:.9f} {:.9f} {:.9f}",
                   FormatSeconds(pose.stamp), t.x(), t.y(), t.z(), q.x(), q.y(), q.z(), q.w());
    if (with_map) fmt::format_to(std::back_inserter(text), " {}", pose.map);
    text += '\n';
  }
  return WriteFileAtomically(path, text);
}

}  // namespace portolan
