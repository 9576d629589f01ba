#include "features/orb_extractor.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "base/check.h"
#include "features/corner_detection.h"
#include "features/corner_spread.h"
#include "features/orb_descriptor.h"
#include "features/subpixel.h"

namespace portolan {
namespace {

/// What a level may take over from finer ones that are short of corners, as a share of its own number. More would crowd
/// coarse levels, whose locations are worth less, with features on top of each other.
constexpr double kMaxExtraShare = 0.5;

template <class T>
Status CheckRange(const char* key, T value, T low, T high) {
  if (value >= low && value <= high) return Ok{};
  return Error{fmt::format("{} is {}, expected {} to {}", key, value, low, high)};
}

/// Features wanted of each level, in proportion to its area, so that all levels are equally dense in their own pixels.
std::vector<int> ShareOut(int num_features, const ScalePyramid& pyramid) {
  std::vector<double> areas;
  double total = 0;
  for (double scale : pyramid.Scales()) total += areas.emplace_back(1.0 / (scale * scale));
  std::vector<int> counts;
  double area_so_far = 0;
  int shared_out = 0;
  for (double area : areas) {
    area_so_far += area;
    counts.push_back(static_cast<int>(std::lround(num_features * area_so_far / total)) - shared_out);
    shared_out += counts.back();
  }
  return counts;
}

}  // namespace

Status OrbOptions::Check() const {
  for (const Status& status : {
           CheckRange("num_features", num_features, 1, 100000),
           CheckRange("pyramid.levels", pyramid.levels, 1, 16),
           CheckRange("pyramid.factor", pyramid.factor, 1.01, 2.0),
           CheckRange("fast_threshold", fast_threshold, 1, 254),
           CheckRange("min_fast_threshold", min_fast_threshold, 1, fast_threshold),
           CheckRange("cell_px", cell_px, 8, 1000),
       }) {
    if (!status) return status;
  }
  return Ok{};
}

struct OrbExtractor::Buffers {
  explicit Buffers(const OrbOptions& options)
      : detector(options.fast_threshold, options.min_fast_threshold, options.cell_px, kOrbBorder),
        wanted(ShareOut(options.num_features, options.pyramid)),
        levels(wanted.size()) {}

  /// Levels 1 and up, each shrunk from the one below.
  void BuildPyramid(const cv::Mat& grey, const ScalePyramid& pyramid) {
    levels[0] = grey;
    for (size_t i = 1; i < levels.size(); ++i) {
      const double scale = pyramid.Scale(static_cast<int>(i));
      const cv::Size size(std::max(1, cvRound(grey.cols / scale)), std::max(1, cvRound(grey.rows / scale)));
      cv::resize(levels[i - 1], levels[i], size, 0, 0, cv::INTER_LINEAR);
    }
  }

  CornerDetector detector;
  const std::vector<int> wanted;  // features per level
  std::vector<cv::Mat> levels;
  cv::Mat smoothed;
  std::vector<cv::Point2f> distorted_px;
};

OrbExtractor::OrbExtractor(const OrbOptions& options) : options_(options) {
  const Status status = options.Check();
  PORTOLAN_CHECK(status.ok()) << status.error().message;
  buffers_ = std::make_unique<Buffers>(options);
}

OrbExtractor::~OrbExtractor() = default;

FeatureSet OrbExtractor::Extract(const cv::Mat& grey, const CameraModel& camera) {
  PORTOLAN_CHECK(grey.type() == CV_8UC1) << "type " << grey.type();
  PORTOLAN_CHECK(grey.cols == camera.pinhole.width && grey.rows == camera.pinhole.height)
      << "image " << grey.cols << "x" << grey.rows << ", camera " << camera.pinhole.width << "x"
      << camera.pinhole.height;
  buffers_->BuildPyramid(grey, options_.pyramid);
  buffers_->distorted_px.clear();
  FeatureSet features;
  int missing = 0;  // what a level is short of, the next ones make up for as far as they may
  for (size_t i = 0; i < buffers_->levels.size(); ++i) {
    const int extra = std::min(missing, static_cast<int>(kMaxExtraShare * buffers_->wanted[i]));
    missing += buffers_->wanted[i] - DescribeLevel(static_cast<int>(i), buffers_->wanted[i] + extra, &features);
  }
  return Undistort(std::move(features), camera);
}

int OrbExtractor::DescribeLevel(int octave, int wanted, FeatureSet* features) {
  const cv::Mat& level = buffers_->levels[static_cast<size_t>(octave)];
  const std::vector<Corner>& corners = buffers_->detector.Detect(level);
  if (corners.empty()) return 0;
  SmoothForOrb(level, &buffers_->smoothed);
  // Pixel centres, not corners, are at whole numbers: a level's pixel x lies at (x + 1/2) * scale - 1/2 of level 0.
  const float scale_x = static_cast<float>(buffers_->levels[0].cols) / static_cast<float>(level.cols);
  const float scale_y = static_cast<float>(buffers_->levels[0].rows) / static_cast<float>(level.rows);
  const std::vector<uint32_t> selected = SpreadCorners(corners, level.cols, level.rows, wanted);
  for (uint32_t index : selected) {
    const Corner& corner = corners[index];
    const float angle_rad = OrbAngle(level, corner.x, corner.y);
    Eigen::Vector2f in_level(static_cast<float>(corner.x), static_cast<float>(corner.y));
    if (options_.subpixel) in_level += SubpixelOffset(level, corner.x, corner.y);
    buffers_->distorted_px.emplace_back((in_level.x() + 0.5f) * scale_x - 0.5f, (in_level.y() + 0.5f) * scale_y - 0.5f);
    features->octaves.push_back(static_cast<uint8_t>(octave));
    features->angles_rad.push_back(angle_rad);
    features->descriptors.push_back(OrbDescriptor(buffers_->smoothed, corner.x, corner.y, angle_rad));
  }
  return static_cast<int>(selected.size());
}

FeatureSet OrbExtractor::Undistort(FeatureSet features, const CameraModel& camera) const {
  const std::vector<cv::Point2f>& distorted_px = buffers_->distorted_px;
  const std::vector<cv::Point2f> ideal_px = camera.IsIdeal() ? distorted_px : camera.Undistort(distorted_px);
  size_t kept = 0;
  features.pixels_px.resize(ideal_px.size());
  for (size_t i = 0; i < ideal_px.size(); ++i) {
    if (!camera.pinhole.Contains({ideal_px[i].x, ideal_px[i].y})) continue;  // NaN is outside, too
    features.pixels_px[kept] = {ideal_px[i].x, ideal_px[i].y};
    features.octaves[kept] = features.octaves[i];
    features.angles_rad[kept] = features.angles_rad[i];
    features.descriptors[kept] = features.descriptors[i];
    ++kept;
  }
  features.pixels_px.resize(kept);
  features.octaves.resize(kept);
  features.angles_rad.resize(kept);
  features.descriptors.resize(kept);
  return features;
}

}  // namespace portolan
