#include "dataset/trajectory_plot.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "base/statistics.h"

namespace portolan {
namespace {

constexpr double kPlotSide = 720;  // pixels of the longer side of the plotting area
constexpr double kMinSide = 240;
constexpr double kLeft = 70, kTop = 56, kBottom = 56, kLegendWidth = 290;
constexpr double kPadding = 0.05;    // free space around the trajectories, of their extent
constexpr double kGapIntervals = 5;  // a line breaks where this many median intervals have no pose
constexpr double kTicksOnLongSide = 10;
constexpr double kTextSize = 14, kSmallTextSize = 12;
constexpr PlotColor kInk{40, 40, 40}, kGrid{228, 228, 228}, kTruth{120, 120, 120}, kClosure{200, 0, 60};
constexpr double kClosureDot = 3.5;  // radius: a good closure's line is too short to be seen
/// Okabe and Ito's palette, told apart by colour-blind readers too.
constexpr std::array<PlotColor, 7> kMapColors{
    {{0, 114, 178}, {213, 94, 0}, {0, 158, 115}, {204, 121, 167}, {230, 159, 0}, {86, 180, 233}, {148, 103, 60}}};

using Polyline = std::vector<Eigen::Vector3d>;

/// What becomes a coloured line and a row of the legend.
struct Series {
  std::vector<Polyline> lines;
  PlotColor color;
  double width = 2;
  std::string name;
  std::string detail;
  double end_dot = 0;  // radius of dots at the ends of its lines
};

std::vector<Polyline> SplitAtGaps(const Trajectory& trajectory, const Sim3d& truth_from_map) {
  const double gap = 2 * kGapIntervals * HalfMedianInterval(trajectory);
  std::vector<Polyline> lines;
  for (size_t i = 0; i < trajectory.size(); ++i) {
    if (i == 0 || SecondsBetween(trajectory[i - 1].stamp, trajectory[i].stamp) > gap) lines.emplace_back();
    lines.back().push_back(truth_from_map * trajectory[i].world_from_camera.translation);
  }
  return lines;
}

const std::optional<Sim3d>& AlignmentOf(const AlignedMap& map, const Evaluation& evaluation, bool per_map) {
  return per_map ? map.truth_from_map : evaluation.joined.truth_from_map;
}

/// Where the estimate has the camera at a time, aligned.
std::optional<Eigen::Vector3d> PositionAt(Timestamp stamp, const Evaluation& evaluation, bool per_map) {
  std::optional<Eigen::Vector3d> position_in_truth;
  double nearest = evaluation.max_dt;
  for (const AlignedMap& map : evaluation.maps) {
    const std::optional<Sim3d>& truth_from_map = AlignmentOf(map, evaluation, per_map);
    if (!truth_from_map) continue;
    for (const TrajectoryPose& pose : map.estimate) {
      const double dt = std::abs(SecondsBetween(pose.stamp, stamp));
      if (dt > nearest) continue;
      nearest = dt;
      position_in_truth = *truth_from_map * pose.world_from_camera.translation;
    }
  }
  return position_in_truth;
}

Series MakeClosures(const std::vector<LoopClosure>& closures, const Evaluation& evaluation, bool per_map) {
  Series series{{}, kClosure, 1.5, "loop closures", std::to_string(closures.size()), kClosureDot};
  for (const LoopClosure& closure : closures) {
    const auto here = PositionAt(closure.stamp, evaluation, per_map);
    const auto before = PositionAt(closure.matched_stamp, evaluation, per_map);
    if (here && before) series.lines.push_back({*before, *here});
  }
  const size_t not_drawn = closures.size() - series.lines.size();
  if (not_drawn > 0) series.detail += fmt::format(", {} without a pose", not_drawn);
  return series;
}

std::vector<Series> MakeSeries(const Evaluation& evaluation, const TrajectoryPlotOptions& options) {
  std::vector<Series> all;
  all.push_back({SplitAtGaps(evaluation.truth, Sim3d()), kTruth, 3.5, "ground truth",
                 fmt::format("{} poses", evaluation.truth.size()), 0});
  for (size_t i = 0; i < evaluation.maps.size(); ++i) {
    const AlignedMap& map = evaluation.maps[i];
    const std::optional<Sim3d>& truth_from_map = AlignmentOf(map, evaluation, options.per_map);
    Series series;
    series.color = kMapColors[i % kMapColors.size()];
    series.name = evaluation.maps.size() > 1 ? fmt::format("map {}", map.map) : "estimate";
    series.detail = fmt::format("{} poses", map.estimate.size());
    if (!truth_from_map) {
      series.detail += ", not aligned";
    } else {
      series.lines = SplitAtGaps(map.estimate, *truth_from_map);
      if (options.per_map) series.detail += fmt::format(", ATE {:.4g}", map.ate.rmse);
    }
    all.push_back(std::move(series));
  }
  if (options.closures) all.push_back(MakeClosures(*options.closures, evaluation, options.per_map));
  return all;
}

/// The plane of the drawing and how its coordinates become pixels.
class Projection {
 public:
  explicit Projection(const std::vector<Series>& all) {
    const auto [truth_low, truth_high] = Bounds({all[0]});
    const Eigen::Vector3d extent = truth_high - truth_low;
    int smallest = 0;
    extent.minCoeff(&smallest);
    across_ = smallest == 0 ? 1 : 0;
    up_ = smallest == 2 ? 1 : 2;
    const auto [low, high] = Bounds(all);
    const double longest = std::max({high[across_] - low[across_], high[up_] - low[up_], 1e-9});
    const double padding = kPadding * longest;
    pixels_per_unit_ = kPlotSide / (longest + 2 * padding);
    width_ = std::max(kMinSide, (high[across_] - low[across_] + 2 * padding) * pixels_per_unit_);
    height_ = std::max(kMinSide, (high[up_] - low[up_] + 2 * padding) * pixels_per_unit_);
    low_across_ = (high[across_] + low[across_]) / 2 - width_ / 2 / pixels_per_unit_;
    low_up_ = (high[up_] + low[up_]) / 2 - height_ / 2 / pixels_per_unit_;
  }

  PlotPoint ToPixels(double across, double up) const {
    return {kLeft + (across - low_across_) * pixels_per_unit_, kTop + height_ - (up - low_up_) * pixels_per_unit_};
  }
  PlotPoint ToPixels(const Eigen::Vector3d& point) const { return ToPixels(point[across_], point[up_]); }

  double width() const { return width_; }
  double height() const { return height_; }
  double low_across() const { return low_across_; }
  double low_up() const { return low_up_; }
  double high_across() const { return low_across_ + width_ / pixels_per_unit_; }
  double high_up() const { return low_up_ + height_ / pixels_per_unit_; }
  char across_name() const { return "xyz"[across_]; }
  char up_name() const { return "xyz"[up_]; }

  /// A round distance of ticks: 1, 2 or 5 times a power of ten.
  double TickStep() const {
    const double wanted = std::max(width_, height_) / pixels_per_unit_ / kTicksOnLongSide;
    const double power = std::pow(10, std::floor(std::log10(wanted)));
    for (const double factor : {1.0, 2.0, 5.0}) {
      if (factor * power >= wanted) return factor * power;
    }
    return 10 * power;
  }

 private:
  static std::pair<Eigen::Vector3d, Eigen::Vector3d> Bounds(const std::vector<Series>& all) {
    Eigen::Vector3d low = Eigen::Vector3d::Constant(1e300);
    Eigen::Vector3d high = -low;
    for (const Series& series : all) {
      for (const Polyline& line : series.lines) {
        for (const Eigen::Vector3d& point : line) {
          low = low.cwiseMin(point);
          high = high.cwiseMax(point);
        }
      }
    }
    return {low, high};
  }

  int across_ = 0, up_ = 1;
  double pixels_per_unit_ = 1, width_ = 0, height_ = 0, low_across_ = 0, low_up_ = 0;
};

void DrawGrid(const Projection& projection, PlotCanvas* canvas) {
  const double step = projection.TickStep();
  const auto label = [&](double value) { return fmt::format("{:g}", std::round(value / step) * step + 0.0); };
  for (double x = std::ceil(projection.low_across() / step) * step; x <= projection.high_across(); x += step) {
    const PlotPoint bottom = projection.ToPixels(x, projection.low_up());
    canvas->AddLine({bottom, {bottom.x, kTop}}, kGrid, 1);
    canvas->AddText({bottom.x, bottom.y + 20}, label(x), kSmallTextSize, kInk, TextAnchor::kMiddle);
  }
  for (double y = std::ceil(projection.low_up() / step) * step; y <= projection.high_up(); y += step) {
    const PlotPoint left = projection.ToPixels(projection.low_across(), y);
    canvas->AddLine({left, {left.x + projection.width(), left.y}}, kGrid, 1);
    canvas->AddText({left.x - 8, left.y + 4}, label(y), kSmallTextSize, kInk, TextAnchor::kEnd);
  }
  const double right = kLeft + projection.width();
  const double bottom = kTop + projection.height();
  canvas->AddLine({{kLeft, kTop}, {right, kTop}, {right, bottom}, {kLeft, bottom}, {kLeft, kTop}}, kInk, 1);
  canvas->AddText({kLeft + projection.width() / 2, bottom + 42}, std::string(1, projection.across_name()), kTextSize,
                  kInk, TextAnchor::kMiddle);
  canvas->AddText({16, kTop + projection.height() / 2}, std::string(1, projection.up_name()), kTextSize, kInk);
}

void DrawLine(std::vector<PlotPoint> points, const Series& series, PlotCanvas* canvas) {
  if (series.end_dot > 0) {
    canvas->AddDot(points.front(), series.end_dot, series.color);
    canvas->AddDot(points.back(), series.end_dot, series.color);
  }
  canvas->AddLine(std::move(points), series.color, series.width);
}

void DrawLegend(const std::vector<Series>& all, const Evaluation& evaluation, double left, PlotCanvas* canvas) {
  double y = kTop + 12;
  for (const Series& series : all) {
    DrawLine({{left, y}, {left + 30, y}}, series, canvas);
    canvas->AddText({left + 40, y + 4}, series.name, kTextSize, kInk);
    canvas->AddText({left + 40, y + 20}, series.detail, kSmallTextSize, kTruth);
    y += 40;
  }
  std::vector<std::string> notes{fmt::format("coverage {:.1f} %", 100 * evaluation.Coverage())};
  if (evaluation.joined.truth_from_map) {
    notes.push_back(fmt::format("ATE {}{:.4g} rmse, {:.4g} max", evaluation.maps.size() > 1 ? "joined " : "",
                                evaluation.joined.ate.rmse, evaluation.joined.ate.max));
  }
  if (evaluation.maps.size() > 1)
    notes.push_back(fmt::format("ATE of maps combined {:.4g}", evaluation.maps_combined.rmse));
  y += 8;
  for (const std::string& note : notes) {
    canvas->AddText({left, y}, note, kTextSize, kInk);
    y += 22;
  }
}

}  // namespace

PlotCanvas DrawTrajectories(const Evaluation& evaluation, const TrajectoryPlotOptions& options) {
  const std::vector<Series> all = MakeSeries(evaluation, options);
  const Projection projection(all);
  constexpr double kLegendRow = 40, kLegendRest = 100;
  const double body = std::max(projection.height(), kLegendRow * static_cast<double>(all.size()) + kLegendRest);
  PlotCanvas canvas(kLeft + projection.width() + 24 + kLegendWidth, kTop + body + kBottom);
  canvas.AddText({kLeft, 34}, options.title, 18, kInk);
  DrawGrid(projection, &canvas);
  for (const Series& series : all) {
    for (const Polyline& line : series.lines) {
      std::vector<PlotPoint> points;
      for (const Eigen::Vector3d& point : line) points.push_back(projection.ToPixels(point));
      DrawLine(std::move(points), series, &canvas);
    }
  }
  canvas.AddDot(projection.ToPixels(all[0].lines.front().front()), 6, kInk);
  DrawLegend(all, evaluation, kLeft + projection.width() + 24, &canvas);
  return canvas;
}

}  // namespace portolan
