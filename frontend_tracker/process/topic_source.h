#pragma once

#include <memory>
#include <optional>

#include "base/bounded_queue.h"
#include "dataset/image_source.h"
#include "process/frontend_options.h"
#include "transport/bus.h"

namespace portolan {

/// Images from the DDS image topic (ROS 2's wire form), as a live source. Ends when it is cancelled, or no image comes
/// for as long as `patience` says. An image of another size than the camera's, or whose time is not after that of the
/// one before, is an error.
class TopicSource : public ImageSource {
 public:
  TopicSource(const CameraModel& camera, const TopicPatience& patience, Bus* bus);

  Result<std::optional<Image>> Next() override;
  void Skip() override {}
  void Cancel() override { queue_.Close(); }
  const CameraModel& camera() const override { return camera_; }
  bool IsLive() const override { return true; }

 private:
  static constexpr size_t kQueue = 4;

  CameraModel camera_;
  TopicPatience patience_;
  std::optional<Timestamp> last_stamp_;  // of the images that were handed on
  BoundedQueue<Image> queue_{kQueue, Overflow::kDropOldest};
  std::unique_ptr<Reader> reader_;  // last: stops before the queue goes
};

/// The source that the options name: a data set, video or device, or the image topic.
Result<std::unique_ptr<ImageSource>> OpenFrontendSource(const FrontendOptions& options, Bus* bus);

}  // namespace portolan
