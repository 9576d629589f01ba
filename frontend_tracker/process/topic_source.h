#pragma once

#include <memory>

#include "base/bounded_queue.h"
#include "dataset/image_source.h"
#include "transport/bus.h"

namespace portolan {

/// Images from the DDS image topic (ROS 2's wire form), as a live source. Ends when it is destroyed or the stream
/// pauses for `end_after_s`.
class TopicSource : public ImageSource {
 public:
  TopicSource(const CameraModel& camera, double end_after_s, Bus* bus);

  Result<std::optional<Image>> Next() override;
  void Skip() override {}
  const CameraModel& camera() const override { return camera_; }
  bool IsLive() const override { return true; }

 private:
  static constexpr size_t kQueue = 4;

  CameraModel camera_;
  double end_after_s_;
  bool started_ = false;
  BoundedQueue<Image> queue_{kQueue, Overflow::kDropOldest};
  std::unique_ptr<Reader> reader_;  // last: stops before the queue goes
};

/// The source that the options name: a data set, video or device, or the image topic.
Result<std::unique_ptr<ImageSource>> OpenFrontendSource(const SourceOptions& options, Bus* bus);

}  // namespace portolan
