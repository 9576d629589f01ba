#include "features/orb_extractor.h"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <future>
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
           CheckRange("threads", threads, 1, 64),
       }) {
    if (!status) return status;
  }
  return Ok{};
}

struct OrbExtractor::Level {
  Level(const OrbOptions& options, int octave_, int wanted_)
      : octave(octave_),
        wanted(wanted_),
        detector(options.fast_threshold, options.min_fast_threshold, options.cell_px, kOrbBorder) {}

  int octave;
  int wanted;  // features
  cv::Mat image, smoothed;
  CornerDetector detector;
  const std::vector<Corner>* corners = nullptr;  // the detector's
  std::vector<uint32_t> selected;                // of the corners
  // Of the selected corners.
  std::vector<cv::Point2f> distorted_px;  // of level 0
  std::vector<float> angles_rad;
  std::vector<Descriptor> descriptors;
};

OrbExtractor::OrbExtractor(const OrbOptions& options) : options_(options) {
  const Status status = options.Check();
  PORTOLAN_CHECK(status.ok()) << status.error().message;
  for (const int wanted : ShareOut(options.num_features, options.pyramid))
    levels_.emplace_back(options, static_cast<int>(levels_.size()), wanted);
}

OrbExtractor::~OrbExtractor() = default;

FeatureSet OrbExtractor::Extract(const cv::Mat& grey, const CameraModel& camera) {
  PORTOLAN_CHECK(grey.type() == CV_8UC1) << "type " << grey.type();
  PORTOLAN_CHECK(grey.cols == camera.pinhole.width && grey.rows == camera.pinhole.height)
      << "image " << grey.cols << "x" << grey.rows << ", camera " << camera.pinhole.width << "x"
      << camera.pinhole.height;
  BuildPyramid(grey);
  ForEachLevel([](Level* level) {
    level->corners = &level->detector.Detect(level->image);
    if (!level->corners->empty()) SmoothForOrb(level->image, &level->smoothed);
  });
  SelectCorners();
  ForEachLevel([this](Level* level) { Describe(level); });
  return Undistort(camera);
}

/// Each level is shrunk from the one below.
void OrbExtractor::BuildPyramid(const cv::Mat& grey) {
  levels_[0].image = grey;
  for (size_t i = 1; i < levels_.size(); ++i) {
    const double scale = options_.pyramid.Scale(levels_[i].octave);
    const cv::Size size(std::max(1, cvRound(grey.cols / scale)), std::max(1, cvRound(grey.rows / scale)));
    cv::resize(levels_[i - 1].image, levels_[i].image, size, 0, 0, cv::INTER_LINEAR);
  }
}

/// Threads take the levels in turn, the largest first: of 8 levels the first two have as many pixels as all others.
template <class Work>
void OrbExtractor::ForEachLevel(const Work& work) {
  std::atomic<size_t> next{0};
  const auto take_levels = [&] {
    for (size_t i = next++; i < levels_.size(); i = next++) work(&levels_[i]);
  };
  std::vector<std::future<void>> others;  // wait at their end, whatever happens
  for (int i = 1; i < options_.threads; ++i) others.push_back(std::async(std::launch::async, take_levels));
  take_levels();
  for (std::future<void>& other : others) other.get();
}

/// What a level is short of, the next ones make up for as far as they may.
void OrbExtractor::SelectCorners() {
  int missing = 0;
  for (Level& level : levels_) {
    const int extra = std::min(missing, static_cast<int>(kMaxExtraShare * level.wanted));
    level.selected = SpreadCorners(*level.corners, level.image.cols, level.image.rows, level.wanted + extra);
    missing += level.wanted - static_cast<int>(level.selected.size());
  }
}

void OrbExtractor::Describe(Level* level) const {
  level->distorted_px.clear();
  level->angles_rad.clear();
  level->descriptors.clear();
  // Pixel centres, not corners, are at whole numbers: a level's pixel x lies at (x + 1/2) * scale - 1/2 of level 0.
  const cv::Mat& finest = levels_[0].image;
  const float scale_x = static_cast<float>(finest.cols) / static_cast<float>(level->image.cols);
  const float scale_y = static_cast<float>(finest.rows) / static_cast<float>(level->image.rows);
  for (const uint32_t index : level->selected) {
    const Corner& corner = (*level->corners)[index];
    const float angle_rad = OrbAngle(level->image, corner.x, corner.y);
    Eigen::Vector2f in_level(static_cast<float>(corner.x), static_cast<float>(corner.y));
    if (options_.subpixel) in_level += SubpixelOffset(level->image, corner.x, corner.y);
    level->distorted_px.emplace_back((in_level.x() + 0.5f) * scale_x - 0.5f, (in_level.y() + 0.5f) * scale_y - 0.5f);
    level->angles_rad.push_back(angle_rad);
    level->descriptors.push_back(OrbDescriptor(level->smoothed, corner.x, corner.y, angle_rad));
  }
}

/// The features of all levels at their ideal pixels, without those outside the ideal image.
FeatureSet OrbExtractor::Undistort(const CameraModel& camera) const {
  FeatureSet features;
  for (const Level& level : levels_) {
    if (level.distorted_px.empty()) continue;
    const std::vector<cv::Point2f> ideal_px =
        camera.IsIdeal() ? level.distorted_px : camera.Undistort(level.distorted_px);
    for (size_t i = 0; i < ideal_px.size(); ++i) {
      if (!camera.pinhole.Contains({ideal_px[i].x, ideal_px[i].y})) continue;  // NaN is outside, too
      features.pixels_px.emplace_back(ideal_px[i].x, ideal_px[i].y);
      features.octaves.push_back(static_cast<uint8_t>(level.octave));
      features.angles_rad.push_back(level.angles_rad[i]);
      features.descriptors.push_back(level.descriptors[i]);
    }
  }
  return features;
}

}  // namespace portolan
