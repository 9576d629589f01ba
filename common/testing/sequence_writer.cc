#include "testing/sequence_writer.h"

#include <fmt/format.h>

#include <filesystem>
#include <fstream>
#include <opencv2/imgcodecs.hpp>
#include <system_error>
#include <utility>
#include <vector>

namespace portolan {
namespace {

namespace fs = std::filesystem;

constexpr int kJpegQuality = 95;

/// The files of one layout, relative to its folder.
struct Files {
  std::string picture_folder;
  std::function<std::string(size_t, Timestamp)> picture_name;  // without extension
  std::function<std::vector<std::pair<std::string, std::string>>(const SyntheticSequence&, const std::string&)>
      texts;  // path, content
};

std::string Seconds(Timestamp stamp) {
  return fmt::format("{:.6f}", stamp.Seconds());
}

/// "tx ty tz qx qy qz qw" with enough digits for the exact value to a nanometre.
std::string TumPose(const Rigid3d& pose) {
  const Eigen::Vector3d& t = pose.translation;
  const Eigen::Quaterniond& q = pose.rotation;
  return fmt::format("{:.9f} {:.9f} {:.9f} {:.12f} {:.12f} {:.12f} {:.12f}", t.x(), t.y(), t.z(), q.x(), q.y(), q.z(),
                     q.w());
}

Files TumFiles() {
  const auto name = [](size_t, Timestamp stamp) { return Seconds(stamp); };
  const auto texts = [](const SyntheticSequence& sequence, const std::string& extension) {
    std::string pictures = "# timestamp filename\n", truth = "# timestamp tx ty tz qx qy qz qw\n";
    for (const SyntheticFrame& frame : sequence.frames()) {
      const std::string stamp = Seconds(frame.stamp);
      pictures += stamp + " rgb/" + stamp + extension + "\n";
      truth += stamp + " " + TumPose(frame.world_from_camera) + "\n";
    }
    const PinholeCamera& camera = sequence.camera();
    const std::string yaml = fmt::format(
        "# pinhole, OpenCV order of the distortion (k1 k2 p1 p2); pixel (0,0) is the centre of the top-left pixel\n"
        "model: pinhole\nwidth: {}\nheight: {}\nfx: {}\nfy: {}\ncx: {}\ncy: {}\ndistortion: [0, 0, 0, 0]\nfps: {}\n",
        camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy, sequence.options().fps);
    return std::vector<std::pair<std::string, std::string>>{
        {"groundtruth.txt", truth}, {"camera.yaml", yaml}, {"rgb.txt", pictures}};
  };
  return {"rgb", name, texts};
}

Files KittiFiles() {
  const auto name = [](size_t frame, Timestamp) { return fmt::format("{:06d}", frame); };
  const auto texts = [](const SyntheticSequence& sequence, const std::string&) {
    std::string times, poses;
    const Rigid3d first_from_world = sequence.frames()[0].world_from_camera.Inverse();
    for (const SyntheticFrame& frame : sequence.frames()) {
      times += Seconds(frame.stamp) + "\n";
      const Eigen::Matrix<double, 3, 4> pose = (first_from_world * frame.world_from_camera).Matrix();
      for (int i = 0; i < 12; ++i) poses += fmt::format("{:.9e}{}", pose(i / 4, i % 4), i == 11 ? "\n" : " ");
    }
    const PinholeCamera& c = sequence.camera();
    const std::string calibration = fmt::format("P0: {} 0 {} 0 0 {} {} 0 0 0 1 0\n", c.fx, c.cx, c.fy, c.cy);
    return std::vector<std::pair<std::string, std::string>>{
        {"poses.txt", poses}, {"calib.txt", calibration}, {"times.txt", times}};
  };
  return {"image_0", name, texts};
}

Files EurocFiles() {
  const auto name = [](size_t, Timestamp stamp) { return std::to_string(stamp.ns); };
  const auto texts = [](const SyntheticSequence& sequence, const std::string& extension) {
    std::string pictures = "#timestamp [ns],filename\n";
    std::string truth = "#timestamp,p_x,p_y,p_z,q_w,q_x,q_y,q_z,v_x,v_y,v_z,bw_x,bw_y,bw_z,ba_x,ba_y,ba_z\n";
    for (const SyntheticFrame& frame : sequence.frames()) {
      pictures += fmt::format("{0},{0}{1}\n", frame.stamp.ns, extension);
      const Eigen::Vector3d& t = frame.world_from_camera.translation;
      const Eigen::Quaterniond& q = frame.world_from_camera.rotation;
      // Velocity by a central difference on the path; there is no inertial sensor, so no biases.
      constexpr double kStep = 1e-4;
      const double speed = frame.black ? 0 : sequence.options().speed;
      const Eigen::Vector3d v =
          speed / (2 * kStep) *
          (sequence.path().At(frame.path_s + kStep).translation - sequence.path().At(frame.path_s - kStep).translation);
      truth += fmt::format("{},{:.9f},{:.9f},{:.9f},{:.12f},{:.12f},{:.12f},{:.12f},{:.6f},{:.6f},{:.6f},0,0,0,0,0,0\n",
                           frame.stamp.ns, t.x(), t.y(), t.z(), q.w(), q.x(), q.y(), q.z(), v.x(), v.y(), v.z());
    }
    const PinholeCamera& c = sequence.camera();
    const std::string yaml = fmt::format(
        "sensor_type: camera\ncomment: portolan_synth\nT_BS:\n  cols: 4\n  rows: 4\n"
        "  data: [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]\nrate_hz: {}\n"
        "resolution: [{}, {}]\ncamera_model: pinhole\nintrinsics: [{}, {}, {}, {}]\n"
        "distortion_model: radial-tangential\ndistortion_coefficients: [0.0, 0.0, 0.0, 0.0]\n",
        sequence.options().fps, c.width, c.height, c.fx, c.fy, c.cx, c.cy);
    return std::vector<std::pair<std::string, std::string>>{{"mav0/state_groundtruth_estimate0/data.csv", truth},
                                                            {"mav0/cam0/sensor.yaml", yaml},
                                                            {"mav0/cam0/data.csv", pictures}};
  };
  return {"mav0/cam0/data", name, texts};
}

Files FilesOf(SequenceLayout layout) {
  switch (layout) {
    case SequenceLayout::kTum:
      return TumFiles();
    case SequenceLayout::kKitti:
      return KittiFiles();
    case SequenceLayout::kEuroc:
      return EurocFiles();
  }
  PORTOLAN_CHECK(false) << " layout " << static_cast<int>(layout);
  return {};
}

Status MakeFolder(const fs::path& folder) {
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) return Error{folder.string() + ": can't be made: " + error.message()};
  return Ok{};
}

Status WriteText(const fs::path& path, const std::string& content) {
  if (const Status made = MakeFolder(path.parent_path()); !made.ok()) return made;
  std::ofstream out(path, std::ios::binary);
  out << content;
  out.close();
  if (!out) return Error{path.string() + ": can't be written (disk full, or no permission?)"};
  return Ok{};
}

Status WritePicture(const fs::path& path, const cv::Mat& picture, PictureFormat format) {
  std::vector<uint8_t> bytes;
  const bool jpeg = format == PictureFormat::kJpeg;
  const bool encoded =
      cv::imencode(jpeg ? ".jpg" : ".png", picture, bytes,
                   jpeg ? std::vector<int>{cv::IMWRITE_JPEG_QUALITY, kJpegQuality} : std::vector<int>{});
  PORTOLAN_CHECK(encoded) << " a picture that can't be encoded: " << path.string();
  std::ofstream out(path, std::ios::binary);
  out.write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
  out.close();
  if (!out) return Error{path.string() + ": can't be written (disk full, or no permission?)"};
  return Ok{};
}

Status CheckEmpty(const fs::path& folder) {
  std::error_code error;
  if (!fs::exists(folder, error)) return Ok{};
  if (!fs::is_directory(folder, error)) return Error{folder.string() + ": is a file, expected a folder"};
  if (!fs::is_empty(folder, error))
    return Error{folder.string() +
                 ": is not empty; expected a new or empty folder, or to be told to overwrite (--force)"};
  return Ok{};
}

}  // namespace

Status WriteSequence(const SyntheticSequence& sequence, const SequenceWriterOptions& options,
                     const std::function<bool(size_t, size_t)>& progress) {
  const fs::path folder(options.folder);
  if (const Status empty = CheckEmpty(folder); !empty.ok() && !options.overwrite) return empty;
  const Files files = FilesOf(options.layout);
  const std::string extension = options.format == PictureFormat::kJpeg ? ".jpg" : ".png";
  if (const Status made = MakeFolder(folder / files.picture_folder); !made.ok()) return made;
  SequenceRenderer renderer(sequence);
  for (size_t i = 0; i < sequence.frames().size(); ++i) {
    const fs::path path =
        folder / files.picture_folder / (files.picture_name(i, sequence.frames()[i].stamp) + extension);
    if (const Status written = WritePicture(path, renderer.Render(i), options.format); !written.ok()) return written;
    if (progress && !progress(i + 1, sequence.frames().size()))
      return Error{folder.string() + ": stopped after " + path.filename().string()};
  }
  for (const auto& [path, content] : files.texts(sequence, extension)) {
    if (const Status written = WriteText(folder / path, content); !written.ok()) return written;
  }
  return Ok{};
}

}  // namespace portolan
