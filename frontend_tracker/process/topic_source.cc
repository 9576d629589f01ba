#include "process/topic_source.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <utility>

#include "dataset/calibration.h"

namespace portolan {

TopicSource::TopicSource(const CameraModel& camera, const TopicPatience& patience, Bus* bus)
    : camera_(camera),
      patience_(patience),
      reader_(bus->CreateReader<Image>([this](Image image) { queue_.Push(std::move(image)); })) {}

Result<std::optional<Image>> TopicSource::Next() {
  const double patience_s = last_stamp_ ? patience_.pause_s : patience_.first_image_s;
  const auto deadline =
      std::chrono::steady_clock::now() +
      std::chrono::duration_cast<std::chrono::steady_clock::duration>(std::chrono::duration<double>(patience_s));
  std::optional<Image> image = patience_s > 0 ? queue_.PopUntil(deadline) : queue_.Pop();
  if (!image) {
    if (last_stamp_ && !queue_.closed()) spdlog::info("no image for {} s: the stream has ended", patience_s);
    return std::optional<Image>();
  }
  if (image->grey.cols != camera_.pinhole.width || image->grey.rows != camera_.pinhole.height) {
    return Error{fmt::format("image {} of the topic is {}x{}, the camera file says {}x{}", image->frame,
                             image->grey.cols, image->grey.rows, camera_.pinhole.width, camera_.pinhole.height)};
  }
  if (last_stamp_ && image->stamp.ns <= last_stamp_->ns) {
    return Error{fmt::format("image {} of the topic is of {} ns, which is not after {} ns, the image before",
                             image->frame, image->stamp.ns, last_stamp_->ns)};
  }
  last_stamp_ = image->stamp;
  return image;
}

Result<std::unique_ptr<ImageSource>> OpenFrontendSource(const FrontendOptions& options, Bus* bus) {
  if (options.source.data != kTopicSource) return OpenImageSource(options.source);
  if (options.source.camera_file.empty()) return Error{"the image topic needs a calibration: give --camera FILE"};
  const Result<CameraModel> camera = ReadCalibration(options.source.camera_file);
  if (!camera) return camera.error();
  if (Status checked = camera->Check(); !checked) return checked.error();
  return std::unique_ptr<ImageSource>(std::make_unique<TopicSource>(*camera, options.topic, bus));
}

}  // namespace portolan
