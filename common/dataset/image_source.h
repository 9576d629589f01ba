#pragma once

#include <cstdint>
#include <memory>
#include <opencv2/core.hpp>
#include <optional>
#include <string>

#include "base/result.h"
#include "base/time.h"
#include "geometry/camera_model.h"

namespace portolan {

/// One image of a source.
struct Image {
  uint64_t frame = 0;  ///< number in the source, from 0
  Timestamp stamp;     ///< camera's clock
  cv::Mat grey;        ///< CV_8UC1
};

/// Where images come from: data sets on disk, a video file, a camera. Next() blocks while it reads or decodes. One
/// thread uses it.
class ImageSource {
 public:
  virtual ~ImageSource() = default;
  /// The next image; none at the end. A frame that can't be read (missing, truncated, of another size than its camera)
  /// is an Error that names the file: the caller counts it and may call Next() again for the frame after it.
  virtual Result<std::optional<Image>> Next() = 0;
  /// Stamp of the frame that Next() would return, if known before decoding it (data sets): lets a player drop late
  /// frames unread.
  virtual std::optional<Timestamp> PeekStamp() const { return std::nullopt; }
  /// Passes over the frame that Next() would return, without decoding it.
  virtual void Skip() = 0;
  /// From any thread: nobody wants more. A Next() that waits for an image to come returns none.
  virtual void Cancel() {}
  /// Number of frames if known.
  virtual std::optional<uint64_t> NumFrames() const { return std::nullopt; }
  virtual const CameraModel& camera() const = 0;
  /// True for a source that comes at its own pace (camera): a player must not pace it.
  virtual bool IsLive() const { return false; }
};

/// What a data set folder (or file) was found to be.
enum class DatasetLayout { kKitti, kTum, kEuroc, kPlain, kVideo, kDevice };

struct SourceOptions {
  std::string data;          ///< folder, video file, or /dev/videoN
  std::string camera_file;   ///< empty: found in the data set
  double camera_fps = 30;    ///< for a video without stamps and for V4L2
  uint64_t first_frame = 0;  ///< frames before it are passed over
  uint64_t max_frames = 0;   ///< 0: all
};

/// Tells a layout by its files: KITTI image_0/ (or image_1/ to image_3/, the first that is there) + times.txt, TUM
/// rgb.txt, EuRoC mav0/cam0/data.csv (or cam0/), plain folder times.txt (or images alone), a regular file is a video,
/// /dev/video* a device. Fails, saying what was looked for.
Result<DatasetLayout> DetectLayout(const std::string& data);

/// Opens a source. Lists and stamps are read and checked here (rising times, files that exist), so that bad data ends
/// the program before any work starts; so does a first readable image of another size than the calibration's. The
/// calibration is `options.camera_file`, else camera.yaml, sensor.yaml or calib.txt in the data set's folder (EuRoC: in
/// cam0; a video: in its folder); a device needs `options.camera_file`. Of a calib.txt the row P0 counts, for images of
/// KITTI's image_N/ the row PN.
Result<std::unique_ptr<ImageSource>> OpenImageSource(const SourceOptions& options);

}  // namespace portolan
