#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>

#include "dataset/media_library.h"
#include "dataset/sources.h"

namespace portolan {
namespace {

/// A video file, decoded by FFmpeg through OpenCV.
class VideoSource : public ImageSource {
 public:
  VideoSource(const SourceOptions& options, std::unique_ptr<VideoStream> capture, const CameraModel& camera, double fps)
      : options_(options), capture_(std::move(capture)), camera_(camera), fps_(fps) {}

  Result<std::optional<Image>> Next() override {
    if (!Advance()) return End();
    cv::Mat picture;
    const std::string name = fmt::format("{} frame {}", options_.data, frame_);
    if (!capture_->Retrieve(&picture) || picture.empty()) return Error{name + ": can't be decoded"};
    if (Status same = CheckImageSize(name, picture.size(), camera_); !same) return same.error();
    Image image{frame_, stamp_, {}};
    cv::cvtColor(picture, image.grey, cv::COLOR_BGR2GRAY);
    return std::optional<Image>(std::move(image));
  }

  void Skip() override { static_cast<void>(Advance()); }
  const CameraModel& camera() const override { return camera_; }

  std::optional<uint64_t> NumFrames() const override {
    const uint64_t announced = Announced();
    if (announced <= options_.first_frame) return std::nullopt;
    const uint64_t rest = announced - options_.first_frame;
    return options_.max_frames > 0 ? std::min(rest, options_.max_frames) : rest;
  }

  /// Takes the next frame out of the container. @return false at the end of the span or the file.
  bool Advance() {
    const uint64_t next = grabbed_;
    if (options_.max_frames > 0 && next >= options_.first_frame + options_.max_frames) return false;
    if (at_end_ || !capture_->Grab()) {
      at_end_ = true;
      return false;
    }
    ++grabbed_;
    frame_ = next;
    const Timestamp container{static_cast<int64_t>(std::llround(capture_->Get(cv::CAP_PROP_POS_MSEC) * 1e6))};
    const bool rises = next == 0 || stamp_ < container;
    stamp_ = rises ? container : Timestamp{stamp_.ns + static_cast<int64_t>(1e9 / fps_)};
    return true;
  }

 private:
  /// What the container's header says; 0 if nothing.
  uint64_t Announced() const {
    const double count = capture_->Get(cv::CAP_PROP_FRAME_COUNT);
    return count > 0 ? static_cast<uint64_t>(count) : 0;
  }

  /// The end of the stream, after an error if the file ends well before the number of frames in its header: it was cut
  /// short.
  Result<std::optional<Image>> End() {
    // Some containers only estimate the number from duration and rate.
    const uint64_t tolerance = std::max<uint64_t>(3, Announced() / 50);
    if (!at_end_ || told_end_ || grabbed_ + tolerance >= Announced()) return std::optional<Image>();
    told_end_ = true;
    return Error{
        fmt::format("{}: ends after {} of {} frames: cut short or damaged", options_.data, grabbed_, Announced())};
  }

  const SourceOptions options_;
  std::unique_ptr<VideoStream> capture_;
  const CameraModel camera_;
  const double fps_;
  uint64_t grabbed_ = 0;  ///< frames taken out of the container
  uint64_t frame_ = 0;    ///< number of the last one
  Timestamp stamp_;       ///< and its time
  bool at_end_ = false;
  bool told_end_ = false;
};

}  // namespace

Result<std::unique_ptr<ImageSource>> OpenVideoSource(const SourceOptions& options, const CameraModel& camera) {
  const auto media = LoadMediaModule();
  if (!media) return media.error();
  auto capture = (*media)->open_video(options.data, cv::CAP_FFMPEG);
  if (!capture->IsOpened()) return Error{options.data + ": is not a video that FFmpeg can read"};
  const cv::Size size(static_cast<int>(capture->Get(cv::CAP_PROP_FRAME_WIDTH)),
                      static_cast<int>(capture->Get(cv::CAP_PROP_FRAME_HEIGHT)));
  CameraModel adopted = camera;
  if (Status same = AdoptImageSize(options.data, size, &adopted); !same) return same.error();
  double fps = capture->Get(cv::CAP_PROP_FPS);
  if (!(fps > 0) || !std::isfinite(fps)) fps = options.camera_fps;
  if (!(fps > 0)) return Error{fmt::format("{}: has no frame rate and none is given", options.data)};
  auto source = std::make_unique<VideoSource>(options, std::move(capture), adopted, fps);
  for (uint64_t i = 0; i < options.first_frame; ++i) {
    if (!source->Advance())
      return Error{fmt::format("{}: first frame {} asked for, but there are {}", options.data, options.first_frame, i)};
  }
  return std::unique_ptr<ImageSource>(std::move(source));
}

}  // namespace portolan
