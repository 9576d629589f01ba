#include "tool/graph_picture.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <utility>

namespace portolan {
namespace {

constexpr double kMargin = 130;                  // for the names beside the circle, pixels
constexpr double kSpacing = 90;                  // between neighbours on the circle, at least
constexpr double kMinRadius = 120;               // of the circle
constexpr double kMinDot = 5, kMaxDot = 24;      // radii
constexpr double kMinLine = 1.5, kMaxLine = 10;  // widths
constexpr double kLetters = 12;                  // size
constexpr PlotColor kActive{0, 114, 178}, kDormant{120, 120, 120}, kLinked{230, 159, 0}, kUnlinked{200, 200, 200},
    kText{40, 40, 40};

/// Where the maps are, by their place in the sorted list.
class Circle {
 public:
  explicit Circle(size_t count)
      : count_(static_cast<double>(std::max<size_t>(count, 1))),
        radius_(std::max(kMinRadius, count_ * kSpacing / (2 * M_PI))) {}
  double side() const { return 2 * (radius_ + kMargin); }
  double AngleOf(size_t index) const { return 2 * M_PI * static_cast<double>(index) / count_ - M_PI / 2; }
  /// @param outwards so many pixels outside the circle.
  PlotPoint At(size_t index, double outwards = 0) const {
    const double angle = AngleOf(index), radius = count_ == 1 ? outwards : radius_ + outwards;
    return {side() / 2 + radius * std::cos(angle), side() / 2 + radius * std::sin(angle)};
  }

 private:
  double count_, radius_;
};

/// Activity comes in few switches or in hundreds: its logarithm is drawn.
double WidthOf(uint64_t activity) {
  return std::min(kMaxLine, kMinLine * (1 + std::log2(1 + static_cast<double>(activity))));
}

double DotOf(size_t keyframes) {
  return std::clamp(std::sqrt(static_cast<double>(keyframes)), kMinDot, kMaxDot);
}

}  // namespace

PlotCanvas DrawMapGraph(const DescribedGraph& described) {
  const MapGraph::State state = described.graph.state();
  const Circle circle(state.maps.size());
  PlotCanvas canvas(circle.side(), circle.side());
  std::map<MapId, size_t> index;
  for (const MapId map : state.maps) index.emplace(map, index.size());

  std::set<std::pair<MapId, MapId>> linked;
  for (const MapGraph::Link& link : state.links) linked.insert(std::minmax(link.map, link.other));
  std::set<std::pair<MapId, MapId>> edges = linked;
  for (const MapGraph::Activity& activity : state.activities) edges.insert(std::minmax(activity.map, activity.other));
  for (const auto& edge : edges) {
    const uint64_t activity = described.graph.ActivityOf(edge.first, edge.second);
    const PlotPoint from = circle.At(index.at(edge.first)), to = circle.At(index.at(edge.second));
    canvas.AddLine({from, to}, linked.count(edge) == 1 ? kLinked : kUnlinked, WidthOf(activity));
    canvas.AddText({(from.x + to.x) / 2, (from.y + to.y) / 2 - 4}, std::to_string(activity), kLetters, kText,
                   TextAnchor::kMiddle);
  }

  for (const MapId map : state.maps) {
    const auto found = described.labels.find(map);
    const MapLabel label = found == described.labels.end() ? MapLabel() : found->second;
    const size_t i = index.at(map);
    const double dot = DotOf(label.keyframes);
    canvas.AddDot(circle.At(i), dot, label.is_active ? kActive : kDormant);
    const PlotPoint beside = circle.At(i, dot + 1.5 * kLetters);
    canvas.AddText(beside, ToString(map), kLetters, kText, TextAnchor::kMiddle);
    canvas.AddText({beside.x, beside.y + 1.2 * kLetters}, fmt::format("{} keyframes", label.keyframes), kLetters, kText,
                   TextAnchor::kMiddle);
  }
  return canvas;
}

}  // namespace portolan
