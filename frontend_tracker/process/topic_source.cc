#include "process/topic_source.h"

#include <utility>

#include "dataset/calibration.h"
#include "process/frontend_options.h"

namespace portolan {
namespace {

constexpr double kEndAfterSeconds = 5.0;     // a stream that pauses longer has ended
constexpr double kFirstImageSeconds = 60.0;  // a publisher may be started by hand

}  // namespace

TopicSource::TopicSource(const CameraModel& camera, double end_after_s, Bus* bus)
    : camera_(camera),
      end_after_s_(end_after_s),
      reader_(bus->CreateReader<Image>([this](Image image) { queue_.Push(std::move(image)); })) {}

Result<std::optional<Image>> TopicSource::Next() {
  const double patience_s = started_ ? end_after_s_ : kFirstImageSeconds;
  const auto deadline =
      std::chrono::steady_clock::now() +
      std::chrono::duration_cast<std::chrono::steady_clock::duration>(std::chrono::duration<double>(patience_s));
  std::optional<Image> image = queue_.PopUntil(deadline);
  if (!image) return std::optional<Image>();
  started_ = true;
  if (image->grey.cols != camera_.pinhole.width || image->grey.rows != camera_.pinhole.height) {
    return Error{"image " + std::to_string(image->frame) + " of the topic is " + std::to_string(image->grey.cols) +
                 "x" + std::to_string(image->grey.rows) + ", the camera file says " +
                 std::to_string(camera_.pinhole.width) + "x" + std::to_string(camera_.pinhole.height)};
  }
  return image;
}

Result<std::unique_ptr<ImageSource>> OpenFrontendSource(const SourceOptions& options, Bus* bus) {
  if (options.data != kTopicSource) return OpenImageSource(options);
  if (options.camera_file.empty()) return Error{"the image topic needs a calibration: give --camera FILE"};
  const Result<CameraModel> camera = ReadCalibration(options.camera_file);
  if (!camera) return camera.error();
  if (Status checked = camera->Check(); !checked) return checked.error();
  return std::unique_ptr<ImageSource>(std::make_unique<TopicSource>(*camera, kEndAfterSeconds, bus));
}

}  // namespace portolan
