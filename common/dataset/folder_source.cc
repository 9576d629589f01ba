#include <fmt/format.h>

#include <algorithm>
#include <utility>
#include <vector>

#include "dataset/image_file.h"
#include "dataset/image_list.h"
#include "dataset/sources.h"

namespace portolan {
namespace {

/// Images that are files of their own: KITTI, TUM, EuRoC, plain folders.
class FolderSource : public ImageSource {
 public:
  /// @param images the span to show. @param first_frame number of its first image in the whole list.
  FolderSource(std::vector<ListedImage> images, uint64_t first_frame, const CameraModel& camera)
      : images_(std::move(images)), first_frame_(first_frame), camera_(camera) {}

  Result<std::optional<Image>> Next() override {
    if (next_ == images_.size()) return std::optional<Image>();
    const uint64_t frame = first_frame_ + next_;
    const ListedImage& listed = images_[next_++];
    Result<cv::Mat> grey = ReadGreyImage(listed.path);
    if (!grey) return grey.error();
    if (Status same = CheckImageSize(listed.path, grey->size(), camera_); !same) return same.error();
    return std::optional<Image>(Image{frame, listed.stamp, *grey});
  }

  std::optional<Timestamp> PeekStamp() const override {
    return next_ < images_.size() ? std::optional<Timestamp>(images_[next_].stamp) : std::nullopt;
  }
  void Skip() override { next_ = std::min(next_ + 1, images_.size()); }
  std::optional<uint64_t> NumFrames() const override { return images_.size(); }
  const CameraModel& camera() const override { return camera_; }

 private:
  const std::vector<ListedImage> images_;
  const uint64_t first_frame_;
  const CameraModel camera_;
  size_t next_ = 0;
};

/// Compares the camera with the first image that can be read (one bad file among good ones is a lost frame, not a bad
/// data set).
Status AdoptFirstImageSize(const std::vector<ListedImage>& images, CameraModel* camera) {
  std::string first_failure;
  for (const ListedImage& image : images) {
    const Result<cv::Mat> grey = ReadGreyImage(image.path);
    if (grey) return AdoptImageSize(image.path, grey->size(), camera);
    if (first_failure.empty()) first_failure = grey.error().message;
  }
  return Error{fmt::format("none of {} images can be read; the first: {}", images.size(), first_failure)};
}

}  // namespace

Result<std::unique_ptr<ImageSource>> OpenFolderSource(const SourceOptions& options, DatasetLayout layout,
                                                      const CameraModel& camera) {
  Result<std::vector<ListedImage>> images =
      ReadImageList(options.data, layout, camera.fps > 0 ? camera.fps : options.camera_fps);
  if (!images) return images.error();
  if (options.first_frame >= images->size()) {
    return Error{fmt::format("{}: first frame {} asked for, but there are {} frames", options.data, options.first_frame,
                             images->size())};
  }
  images->erase(images->begin(), images->begin() + static_cast<std::ptrdiff_t>(options.first_frame));
  if (options.max_frames > 0 && images->size() > options.max_frames) images->resize(options.max_frames);
  CameraModel adopted = camera;
  if (Status same = AdoptFirstImageSize(*images, &adopted); !same) return same.error();
  return std::unique_ptr<ImageSource>(std::make_unique<FolderSource>(std::move(*images), options.first_frame, adopted));
}

}  // namespace portolan
