#include <fmt/format.h>

#include <cmath>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>

#include "dataset/media_library.h"
#include "dataset/sources.h"

namespace portolan {
namespace {

/// After so many failures in a row a camera counts as gone (OpenCV waits up to 10 s for each).
constexpr int kMaxFailures = 3;

/// A camera of this machine, through V4L2.
class CameraSource : public ImageSource {
 public:
  CameraSource(const SourceOptions& options, std::unique_ptr<VideoStream> capture, const CameraModel& camera)
      : options_(options), capture_(std::move(capture)), camera_(camera) {}

  Result<std::optional<Image>> Next() override {
    if (failures_ >= kMaxFailures || (options_.max_frames > 0 && frame_ >= options_.max_frames))
      return std::optional<Image>();
    cv::Mat picture;
    if (!Advance() || !capture_->Retrieve(&picture) || picture.empty()) {
      ++failures_;
      return Error{fmt::format("{}: frame {}: the camera delivers no image", options_.data, frame_)};
    }
    failures_ = 0;
    Image image{frame_++, stamp_, {}};
    if (Status same = CheckImageSize(options_.data, picture.size(), camera_); !same) return same.error();
    if (picture.channels() == 1) {
      image.grey = picture;
    } else {
      cv::cvtColor(picture, image.grey, cv::COLOR_BGR2GRAY);
    }
    return std::optional<Image>(std::move(image));
  }

  void Skip() override {
    if (Advance()) ++frame_;
  }
  const CameraModel& camera() const override { return camera_; }
  bool IsLive() const override { return true; }

 private:
  bool Advance() {
    if (!capture_->Grab()) return false;
    // The driver's capture time; drivers that give none leave it where it was.
    const Timestamp driver{static_cast<int64_t>(std::llround(capture_->Get(cv::CAP_PROP_POS_MSEC) * 1e6))};
    driver_stamps_ = driver_stamps_ && stamp_ < driver;
    stamp_ = driver_stamps_ ? driver : Timestamp::Now();
    return true;
  }

  const SourceOptions options_;
  std::unique_ptr<VideoStream> capture_;
  const CameraModel camera_;
  uint64_t frame_ = 0;
  Timestamp stamp_;
  bool driver_stamps_ = true;
  int failures_ = 0;
};

}  // namespace

Result<std::unique_ptr<ImageSource>> OpenCameraSource(const SourceOptions& options, const CameraModel& camera) {
  const auto media = LoadMediaModule();
  if (!media) return media.error();
  return OpenCameraSource(options, camera, (*media)->open_video(options.data, cv::CAP_V4L2));
}

Result<std::unique_ptr<ImageSource>> OpenCameraSource(const SourceOptions& options, const CameraModel& camera,
                                                      std::unique_ptr<VideoStream> capture) {
  if (!capture->IsOpened()) return Error{options.data + ": no camera that V4L2 can open"};
  if (camera.pinhole.width > 0) {
    capture->Set(cv::CAP_PROP_FRAME_WIDTH, camera.pinhole.width);
    capture->Set(cv::CAP_PROP_FRAME_HEIGHT, camera.pinhole.height);
  }
  capture->Set(cv::CAP_PROP_FPS, camera.fps > 0 ? camera.fps : options.camera_fps);
  const cv::Size size(static_cast<int>(capture->Get(cv::CAP_PROP_FRAME_WIDTH)),
                      static_cast<int>(capture->Get(cv::CAP_PROP_FRAME_HEIGHT)));
  CameraModel adopted = camera;
  if (Status same = AdoptImageSize(options.data, size, &adopted); !same) return same.error();
  return std::unique_ptr<ImageSource>(std::make_unique<CameraSource>(options, std::move(capture), adopted));
}

}  // namespace portolan
