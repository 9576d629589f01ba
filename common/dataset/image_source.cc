#include "dataset/image_source.h"

#include <fmt/format.h>

#include <filesystem>

#include "dataset/calibration.h"
#include "dataset/image_file.h"
#include "dataset/image_list.h"
#include "dataset/sources.h"

namespace portolan {
namespace {

namespace fs = std::filesystem;

Result<std::string> FindCameraFile(const SourceOptions& options, DatasetLayout layout) {
  if (!options.camera_file.empty()) return options.camera_file;
  std::vector<std::string> folders{options.data};
  if (layout == DatasetLayout::kDevice) return Error{options.data + ": a camera needs a calibration file (--camera)"};
  if (layout == DatasetLayout::kVideo) folders = {fs::path(options.data).parent_path().string()};
  if (layout == DatasetLayout::kEuroc) folders.push_back(FindEurocCamera(options.data));
  for (const std::string& folder : folders) {
    for (const char* name : {"camera.yaml", "sensor.yaml", "calib.txt"}) {
      const fs::path path = fs::path(folder) / name;
      if (fs::exists(path)) return path.string();
    }
  }
  return Error{fmt::format(
      "{}: no calibration: looked for camera.yaml, sensor.yaml and calib.txt in '{}'; name one with --camera",
      options.data, fmt::join(folders, "' and '"))};
}

}  // namespace

Result<DatasetLayout> DetectLayout(const std::string& data) {
  if (data.compare(0, 10, "/dev/video") == 0) return DatasetLayout::kDevice;
  std::error_code failure;
  if (fs::is_regular_file(data, failure)) return DatasetLayout::kVideo;
  if (!fs::is_directory(data, failure)) return Error{data + ": no such folder or file"};
  if (FindKittiCamera(data) && fs::exists(data + "/times.txt")) return DatasetLayout::kKitti;
  if (fs::exists(data + "/rgb.txt")) return DatasetLayout::kTum;
  if (!FindEurocCamera(data).empty()) return DatasetLayout::kEuroc;
  if (fs::exists(data + "/times.txt") || !ListImageFiles(data).empty()) return DatasetLayout::kPlain;
  return Error{
      data +
      ": no data set: looked for image_0/ to image_3/ with times.txt (KITTI), rgb.txt (TUM), mav0/cam0/data.csv, "
      "cam0/data.csv or data.csv (EuRoC), times.txt or images (plain folder)"};
}

Result<std::unique_ptr<ImageSource>> OpenImageSource(const SourceOptions& options) {
  const Result<DatasetLayout> layout = DetectLayout(options.data);
  if (!layout) return layout.error();
  const Result<std::string> camera_file = FindCameraFile(options, *layout);
  if (!camera_file) return camera_file.error();
  const int kitti_camera = *layout == DatasetLayout::kKitti ? FindKittiCamera(options.data).value_or(0) : 0;
  const Result<CameraModel> camera = ReadCalibration(*camera_file, kitti_camera);
  if (!camera) return camera.error();
  if (*layout == DatasetLayout::kVideo) return OpenVideoSource(options, *camera);
  if (*layout == DatasetLayout::kDevice) return OpenCameraSource(options, *camera);
  return OpenFolderSource(options, *layout, *camera);
}

Status CheckImageSize(const std::string& image, cv::Size size, const CameraModel& camera) {
  if (size.width == camera.pinhole.width && size.height == camera.pinhole.height) return Ok{};
  return Error{fmt::format("{}: is {} x {} pixels, but the camera's calibration is for {} x {}", image, size.width,
                           size.height, camera.pinhole.width, camera.pinhole.height)};
}

Status AdoptImageSize(const std::string& image, cv::Size size, CameraModel* camera) {
  if (camera->pinhole.width == 0 && camera->pinhole.height == 0) {
    camera->pinhole.width = size.width;
    camera->pinhole.height = size.height;
  }
  if (Status same = CheckImageSize(image, size, *camera); !same) return same;
  if (Status valid = camera->Check(); !valid)
    return Error{fmt::format("camera of {}: {}", image, valid.error().message)};
  return Ok{};
}

}  // namespace portolan
