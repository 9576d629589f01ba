#include "dataset/calibration.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <optional>
#include <sstream>
#include <string>
#include <vector>

#include "base/check.h"
#include "dataset/calibration_fields.h"
#include "dataset/text_table.h"

namespace portolan {
namespace {

void SetRadialTangential(const std::vector<double>& coefficients, CameraModel* camera) {
  std::copy(coefficients.begin(), coefficients.end(), camera->coefficients.begin());
  const bool any = std::any_of(coefficients.begin(), coefficients.end(), [](double k) { return k != 0; });
  camera->distortion = any ? Distortion::kRadialTangential : Distortion::kNone;
}

void SetKannalaBrandt(const std::vector<double>& coefficients, CameraModel* camera) {
  std::copy(coefficients.begin(), coefficients.end(), camera->coefficients.begin());
  camera->distortion = Distortion::kKannalaBrandt4;
}

void SetIntrinsics(const std::vector<double>& fx_fy_cx_cy, CameraModel* camera) {
  camera->pinhole.fx = fx_fy_cx_cy[0];
  camera->pinhole.fy = fx_fy_cx_cy[1];
  camera->pinhole.cx = fx_fy_cx_cy[2];
  camera->pinhole.cy = fx_fy_cx_cy[3];
}

/// Portolan's own form. The only one whose keys are all known: others belong to programs that keep more in the file.
CameraModel ReadOwn(CalibrationFields& fields) {
  fields.AllowOnly({"model", "width", "height", "fx", "fy", "cx", "cy", "distortion", "fps"});
  CameraModel camera;
  const std::string model = fields.Text("model");
  if (model != "pinhole" && model != "fisheye") fields.AddMistake("model", "pinhole or fisheye");
  camera.pinhole.width = fields.Pixels("width");
  camera.pinhole.height = fields.Pixels("height");
  SetIntrinsics({fields.Positive("fx"), fields.Positive("fy"), fields.Number("cx"), fields.Number("cy")}, &camera);
  camera.fps = fields.PositiveOr("fps", 0);
  if (model == "fisheye") {
    SetKannalaBrandt(fields.Numbers("distortion", {4}), &camera);
  } else if (fields.Has("distortion")) {
    SetRadialTangential(fields.Numbers("distortion", {0, 4, 5}), &camera);
  }
  return camera;
}

/// EuRoC's sensor.yaml.
CameraModel ReadEuroc(CalibrationFields& fields) {
  CameraModel camera;
  if (fields.Text("camera_model") != "pinhole") fields.AddMistake("camera_model", "pinhole");
  const std::vector<double> resolution = fields.Numbers("resolution", {2});
  for (const double side : resolution) {
    if (side < 1 || side != static_cast<int>(side)) fields.AddMistake("resolution", "[width, height] in whole pixels");
  }
  camera.pinhole.width = static_cast<int>(resolution[0]);
  camera.pinhole.height = static_cast<int>(resolution[1]);
  const std::vector<double> intrinsics = fields.Numbers("intrinsics", {4});
  if (intrinsics[0] <= 0 || intrinsics[1] <= 0)
    fields.AddMistake("intrinsics", "[fx, fy, cx, cy] with fx and fy above 0");
  SetIntrinsics(intrinsics, &camera);
  camera.fps = fields.PositiveOr("rate_hz", 0);
  const std::string model = fields.Text("distortion_model");
  if (model == "radial-tangential" || model == "radtan") {
    SetRadialTangential(fields.Numbers("distortion_coefficients", {4, 5}), &camera);
  } else if (model == "equidistant") {
    SetKannalaBrandt(fields.Numbers("distortion_coefficients", {4}), &camera);
  } else {
    fields.AddMistake("distortion_model", "radial-tangential or equidistant");
  }
  return camera;
}

/// What the two forms of ROS camera_info call the same.
struct RosKeys {
  std::string width, height, k, d;
};

/// ROS camera_info. K is row-major 3x3.
CameraModel ReadRos(const RosKeys& keys, CalibrationFields& fields) {
  CameraModel camera;
  camera.pinhole.width = fields.Pixels(keys.width);
  camera.pinhole.height = fields.Pixels(keys.height);
  const std::vector<double> k = fields.Numbers(keys.k, {9});
  if (k[0] <= 0 || k[4] <= 0 || k[1] != 0 || k[3] != 0 || k[6] != 0 || k[7] != 0 || k[8] != 1) {
    fields.AddMistake(keys.k, "[fx, 0, cx, 0, fy, cy, 0, 0, 1] with fx and fy above 0");
  }
  SetIntrinsics({k[0], k[4], k[2], k[5]}, &camera);
  const std::string model = fields.Text("distortion_model");
  if (model == "plumb_bob") {
    SetRadialTangential(fields.Numbers(keys.d, {0, 4, 5}), &camera);
  } else if (model == "equidistant" || model == "fisheye") {
    SetKannalaBrandt(fields.Numbers(keys.d, {4}), &camera);
  } else {
    fields.AddMistake("distortion_model", "plumb_bob or equidistant");
  }
  return camera;
}

/// As camera_calibration writes it.
CameraModel ReadRosFile(CalibrationFields& fields) {
  return ReadRos({"image_width", "image_height", "camera_matrix.data", "distortion_coefficients.data"}, fields);
}

/// The message sensor_msgs/CameraInfo as `ros2 topic echo` prints it.
CameraModel ReadRosMessage(CalibrationFields& fields) {
  return ReadRos({"width", "height", "k", "d"}, fields);
}

/// ORB-SLAM style: "Camera.fx" or, of a newer kind, "Camera1.fx". Older files have no image size: it stays 0.
CameraModel ReadOrbSlam(CalibrationFields& fields) {
  const std::string prefix = fields.Has("Camera1.fx") ? "Camera1." : "Camera.";
  CameraModel camera;
  if (fields.Has("Camera.width") || fields.Has("Camera.height")) {
    camera.pinhole.width = fields.Pixels("Camera.width");
    camera.pinhole.height = fields.Pixels("Camera.height");
  }
  SetIntrinsics({fields.Positive(prefix + "fx"), fields.Positive(prefix + "fy"), fields.Number(prefix + "cx"),
                 fields.Number(prefix + "cy")},
                &camera);
  camera.fps = fields.PositiveOr("Camera.fps", 0);
  const std::string type = fields.Has("Camera.type") ? fields.Text("Camera.type") : "PinHole";
  if (type == "PinHole") {
    std::vector<double> coefficients;
    for (const char* name : {"k1", "k2", "p1", "p2", "k3"}) coefficients.push_back(fields.NumberOr(prefix + name, 0));
    SetRadialTangential(coefficients, &camera);
  } else if (type == "KannalaBrandt8") {
    std::vector<double> coefficients;
    for (const char* name : {"k1", "k2", "k3", "k4"}) coefficients.push_back(fields.Number(prefix + name));
    SetKannalaBrandt(coefficients, &camera);
  } else if (type != "Rectified") {
    fields.AddMistake("Camera.type", "PinHole, Rectified or KannalaBrandt8");
  }
  return camera;
}

/// KITTI calib.txt: the row "P0: fx 0 cx 0 0 fy cy 0 0 0 1 0", a 3x4 projection matrix K [I | t]. The other cameras lie
/// beside camera 0: K t, the fourth column, is not 0 in their rows, and not asked for here.
Result<CameraModel> ReadKitti(const std::string& path, int kitti_camera) {
  const Result<std::vector<TextRow>> rows = ReadTextTable(path);
  if (!rows) return rows.error();
  const std::string name = fmt::format("P{}", kitti_camera);
  const TextRow* found = nullptr;
  for (const TextRow& row : *rows) {
    if (row.fields[0] != name + ":") continue;
    if (found)
      return Error{fmt::format("{}:{}: {} is given twice, first on line {}", path, row.line, name, found->line)};
    found = &row;
  }
  if (!found) return Error{fmt::format("{}: row '{}:' is missing", path, name)};
  const Error bad{fmt::format("{}:{}: {}: expected the 12 finite numbers fx 0 cx {} with fx and fy above 0, found '{}'",
                              path, found->line, name,
                              kitti_camera == 0 ? "0 0 fy cy 0 0 0 1 0" : "a 0 fy cy b 0 0 1 c",
                              fmt::join(found->fields.begin() + 1, found->fields.end(), " "))};
  if (found->fields.size() != 13) return bad;
  std::array<double, 12> p{};
  for (size_t i = 0; i < p.size(); ++i) {
    if (!ParseNumber(found->fields[i + 1], &p[i])) return bad;
  }
  const bool is_beside = p[3] != 0 || p[7] != 0 || p[11] != 0;
  const bool is_projection = p[1] == 0 && p[4] == 0 && p[8] == 0 && p[9] == 0 && p[10] == 1;
  if (!is_projection || (is_beside && kitti_camera == 0) || p[0] <= 0 || p[5] <= 0) return bad;
  CameraModel camera;
  SetIntrinsics({p[0], p[5], p[2], p[6]}, &camera);
  return camera;
}

/// A row "P0:" to "P3:" or "Tr:" tells KITTI's form.
bool LooksLikeKitti(const std::string& text) {
  constexpr std::array<const char*, 5> kRows{"P0:", "P1:", "P2:", "P3:", "Tr:"};
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    if (std::find(kRows.begin(), kRows.end(), line.substr(0, 3)) != kRows.end()) return true;
  }
  return false;
}

/// OpenCV's FileStorage starts its files with "%YAML:1.0", which is no YAML directive; blanked, so that lines keep
/// their numbers.
std::string WithoutOpenCvHeader(std::string text) {
  if (text.compare(0, 6, "%YAML:") == 0) text.erase(0, text.find('\n'));
  return text;
}

/// `ros2 topic echo` ends a message with "---", which would begin a second YAML document.
std::string WithoutLastSeparator(std::string text) {
  const size_t end = text.find_last_not_of(" \r\n");
  if (end != std::string::npos && end >= 3 && text.compare(end - 3, 4, "\n---") == 0) text.resize(end - 2);
  return text;
}

/// Empty if the keys are of no known form.
std::optional<CameraModel> ReadKnownForm(CalibrationFields& fields) {
  if (fields.Has("camera_matrix.data")) return ReadRosFile(fields);
  if (fields.Has("camera_model") || fields.Has("intrinsics")) return ReadEuroc(fields);
  if (fields.Has("Camera.fx") || fields.Has("Camera1.fx") || fields.Has("Camera.type")) return ReadOrbSlam(fields);
  if (fields.Has("model") || fields.Has("fx")) return ReadOwn(fields);
  if (fields.Has("k") || fields.Has("d")) return ReadRosMessage(fields);
  return std::nullopt;
}

}  // namespace

Result<CameraModel> ReadCalibration(const std::string& path, int kitti_camera) {
  PORTOLAN_CHECK(kitti_camera >= 0 && kitti_camera <= 3) << "KITTI camera " << kitti_camera;
  const Result<std::string> text = ReadTextFile(path);
  if (!text) return text.error();
  if (LooksLikeKitti(*text)) return ReadKitti(path, kitti_camera);
  const Result<std::vector<YamlEntry>> entries = ParseFlatYaml(WithoutLastSeparator(WithoutOpenCvHeader(*text)), path);
  if (!entries) return entries.error();
  CalibrationFields fields(path, *entries);
  const std::optional<CameraModel> camera = ReadKnownForm(fields);
  if (!camera) {
    return Error{path +
                 ": not a camera calibration: expected the keys of Portolan (model, fx, ...), EuRoC (camera_model, "
                 "intrinsics), ROS (camera_matrix; or k, d), ORB-SLAM (Camera.fx) or KITTI (P0:)"};
  }
  if (Status read = fields.Check(); !read) return read.error();
  if (camera->pinhole.width > 0) {
    if (Status valid = camera->Check(); !valid) return Error{path + ": " + valid.error().message};
  }
  return *camera;
}

}  // namespace portolan
