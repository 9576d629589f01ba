#include "dataset/calibration.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <optional>
#include <sstream>
#include <string>
#include <vector>

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

/// ROS camera_info as camera_calibration writes it. K is row-major 3x3.
CameraModel ReadRos(CalibrationFields& fields) {
  CameraModel camera;
  camera.pinhole.width = fields.Pixels("image_width");
  camera.pinhole.height = fields.Pixels("image_height");
  const std::vector<double> k = fields.Numbers("camera_matrix.data", {9});
  if (k[0] <= 0 || k[4] <= 0 || k[1] != 0 || k[3] != 0 || k[6] != 0 || k[7] != 0 || k[8] != 1) {
    fields.AddMistake("camera_matrix.data", "[fx, 0, cx, 0, fy, cy, 0, 0, 1] with fx and fy above 0");
  }
  SetIntrinsics({k[0], k[4], k[2], k[5]}, &camera);
  const std::string model = fields.Text("distortion_model");
  if (model == "plumb_bob") {
    SetRadialTangential(fields.Numbers("distortion_coefficients.data", {0, 4, 5}), &camera);
  } else if (model == "equidistant" || model == "fisheye") {
    SetKannalaBrandt(fields.Numbers("distortion_coefficients.data", {4}), &camera);
  } else {
    fields.AddMistake("distortion_model", "plumb_bob or equidistant");
  }
  return camera;
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

/// KITTI calib.txt: the row "P0: fx 0 cx 0 0 fy cy 0 0 0 1 0", a 3x4 projection matrix.
Result<CameraModel> ReadKitti(const std::string& path) {
  const Result<std::vector<TextRow>> rows = ReadTextTable(path);
  if (!rows) return rows.error();
  const TextRow* p0 = nullptr;
  for (const TextRow& row : *rows) {
    if (row.fields[0] != "P0:") continue;
    if (p0) return Error{fmt::format("{}:{}: P0 is given twice, first on line {}", path, row.line, p0->line)};
    p0 = &row;
  }
  if (!p0) return Error{path + ": row 'P0:' is missing"};
  const Error bad{fmt::format(
      "{}:{}: P0: expected the 12 finite numbers fx 0 cx 0 0 fy cy 0 0 0 1 0 with fx and fy above 0, found '{}'", path,
      p0->line, fmt::join(p0->fields.begin() + 1, p0->fields.end(), " "))};
  if (p0->fields.size() != 13) return bad;
  std::array<double, 12> p{};
  for (size_t i = 0; i < p.size(); ++i) {
    if (!ParseNumber(p0->fields[i + 1], &p[i])) return bad;
  }
  const bool is_projection =
      p[1] == 0 && p[4] == 0 && p[8] == 0 && p[9] == 0 && p[10] == 1 && p[3] == 0 && p[7] == 0 && p[11] == 0;
  if (!is_projection || p[0] <= 0 || p[5] <= 0) return bad;
  CameraModel camera;
  SetIntrinsics({p[0], p[5], p[2], p[6]}, &camera);
  return camera;
}

/// A row "P0:" to "P3:" or "Tr:" tells KITTI's form.
bool LooksLikeKitti(const std::string& text) {
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    const std::string start = line.substr(0, 3);
    if (start == "P0:" || start == "P1:" || start == "Tr:") return true;
  }
  return false;
}

/// OpenCV's FileStorage starts its files with "%YAML:1.0", which is no YAML directive; blanked, so that lines keep
/// their numbers.
std::string WithoutOpenCvHeader(std::string text) {
  if (text.compare(0, 6, "%YAML:") == 0) text.erase(0, text.find('\n'));
  return text;
}

/// Empty if the keys are of no known form.
std::optional<CameraModel> ReadKnownForm(CalibrationFields& fields) {
  if (fields.Has("camera_matrix.data")) return ReadRos(fields);
  if (fields.Has("camera_model") || fields.Has("intrinsics")) return ReadEuroc(fields);
  if (fields.Has("Camera.fx") || fields.Has("Camera1.fx") || fields.Has("Camera.type")) return ReadOrbSlam(fields);
  if (fields.Has("model") || fields.Has("fx")) return ReadOwn(fields);
  return std::nullopt;
}

}  // namespace

Result<CameraModel> ReadCalibration(const std::string& path) {
  const Result<std::string> text = ReadTextFile(path);
  if (!text) return text.error();
  if (LooksLikeKitti(*text)) return ReadKitti(path);
  const Result<std::vector<YamlEntry>> entries = ParseFlatYaml(WithoutOpenCvHeader(*text), path);
  if (!entries) return entries.error();
  CalibrationFields fields(path, *entries);
  const std::optional<CameraModel> camera = ReadKnownForm(fields);
  if (!camera) {
    return Error{path +
                 ": not a camera calibration: expected the keys of Portolan (model, fx, ...), EuRoC (camera_model, "
                 "intrinsics), ROS "
                 "(camera_matrix), ORB-SLAM (Camera.fx) or KITTI (P0:)"};
  }
  if (Status read = fields.Check(); !read) return read.error();
  if (camera->pinhole.width > 0) {
    if (Status valid = camera->Check(); !valid) return Error{path + ": " + valid.error().message};
  }
  return *camera;
}

}  // namespace portolan
