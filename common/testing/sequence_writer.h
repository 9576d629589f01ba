#pragma once

#include <functional>
#include <string>

#include "base/result.h"
#include "testing/synthetic_sequence.h"

namespace portolan {

/// The folder layouts of the data sets that SLAM systems read.
enum class SequenceLayout { kTum, kKitti, kEuroc };
enum class PictureFormat { kPng, kJpeg };

struct SequenceWriterOptions {
  std::string folder;  ///< made if it is not there
  SequenceLayout layout = SequenceLayout::kTum;
  PictureFormat format = PictureFormat::kJpeg;  ///< JPEG of quality 95
  bool overwrite = false;                       ///< write into a folder that is not empty
};

/// Renders a sequence to disk with its camera file and exact ground truth:
/// TUM    rgb/, rgb.txt, groundtruth.txt, camera.yaml
/// KITTI  image_0/, times.txt, calib.txt, poses.txt (of the camera in the first camera's frame)
/// EuRoC  mav0/cam0/data/, mav0/cam0/data.csv, mav0/cam0/sensor.yaml, mav0/state_groundtruth_estimate0/data.csv (body =
/// camera) The lists come last, so that a run cut short leaves nothing that looks whole.
/// @param progress called with (frames written, frames in all) after each frame; may be empty. Returning false stops
/// with an Error. Fails, naming the path, when the folder is not empty (without overwrite), can't be made or a file
/// can't be written.
Status WriteSequence(const SyntheticSequence& sequence, const SequenceWriterOptions& options,
                     const std::function<bool(size_t, size_t)>& progress);

}  // namespace portolan
