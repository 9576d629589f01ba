#include "place_recognition/landmark_search.h"

#include <algorithm>

#include "map/landmark_projection.h"

namespace portolan {
namespace {

constexpr int kNobody = 257;  // farther than any descriptor
constexpr int kMinExpectedInCell = 4;

size_t CellOf(const Eigen::Vector2d& pixel_px, const PinholeCamera& camera) {
  const auto column = static_cast<int>(pixel_px.x() / camera.width * LandmarkSearchResult::kColumns);
  const auto row = static_cast<int>(pixel_px.y() / camera.height * LandmarkSearchResult::kRows);
  return static_cast<size_t>(std::clamp(row, 0, LandmarkSearchResult::kRows - 1) * LandmarkSearchResult::kColumns +
                             std::clamp(column, 0, LandmarkSearchResult::kColumns - 1));
}

/// Nearest descriptor among features. @return distance kNobody if there is none.
FoundLandmark Nearest(const Descriptor& descriptor, const FeatureSet& features, const std::vector<uint32_t>& among) {
  FoundLandmark best;
  best.distance = kNobody;
  for (const uint32_t feature : among) {
    const int distance = HammingDistance(descriptor, features.descriptors[feature]);
    if (distance >= best.distance) continue;
    best.distance = distance;
    best.feature = feature;
  }
  return best;
}

/// A landmark's claim to a feature.
struct Claim : FoundLandmark {
  bool is_expected = false;
  size_t cell = 0;  ///< where it was expected

  Claim() = default;
  Claim(const FoundLandmark& found, bool expected, size_t in_cell)
      : FoundLandmark(found), is_expected(expected), cell(in_cell) {}
};

/// Makes the winning claims the result.
void Settle(const std::vector<Claim>& claims, LandmarkSearchResult* result) {
  for (const Claim& claim : claims) {
    if (claim.distance == kNobody) continue;
    result->found.push_back(claim);
    if (claim.is_expected) ++result->cells[claim.cell].found;
  }
  std::sort(result->found.begin(), result->found.end(),
            [](const FoundLandmark& a, const FoundLandmark& b) { return a.landmark < b.landmark; });
  for (const ExpectedLandmarks& cell : result->cells) {
    result->expected.expected += cell.expected;
    result->expected.found += cell.found;
  }
}

}  // namespace

double LandmarkSearchResult::ShareOfCells(double min_share) const {
  int expected_cells = 0, confirmed = 0;
  for (const ExpectedLandmarks& cell : cells) {
    if (cell.expected < kMinExpectedInCell) continue;
    ++expected_cells;
    confirmed += cell.found > 0 && cell.Share() >= min_share ? 1 : 0;
  }
  return expected_cells > 0 ? static_cast<double>(confirmed) / expected_cells : 0;
}

double LandmarkSearchResult::Spread(const KeyFrameData& image) const {
  std::array<bool, kColumns * kRows> is_covered{};
  for (const FoundLandmark& landmark : found)
    is_covered[CellOf(image.features.pixels_px[landmark.feature].cast<double>(), image.camera)] = true;
  const auto covered = std::count(is_covered.begin(), is_covered.end(), true);
  return static_cast<double>(covered) / static_cast<double>(is_covered.size());
}

LandmarkSearchResult FindLandmarks(const std::vector<const MapPoint*>& landmarks, const Rigid3d& camera_from_map,
                                   const KeyFrameData& image, const LandmarkSearchOptions& options) {
  LandmarkSearchResult result;
  const LandmarkProjection projection(image.camera, image.pyramid, camera_from_map);
  const FeatureSet& features = image.features;
  const std::vector<double> scales = image.pyramid.Scales();
  Claim nobody;
  nobody.distance = kNobody;
  std::vector<Claim> claims(features.size(), nobody);
  std::vector<uint32_t> near;
  for (size_t i = 0; i < landmarks.size(); ++i) {
    const auto predicted = projection.Predict(*landmarks[i]);
    if (!predicted) continue;
    ++result.visible;
    const bool is_expected = predicted->viewing_cosine >= options.min_viewing_cosine &&
                             landmarks[i]->observations.size() >= options.min_observations;
    const size_t cell = CellOf(predicted->pixel_px, image.camera);
    if (is_expected) ++result.cells[cell].expected;
    near.clear();
    const double radius_px = options.radius_px * scales[static_cast<size_t>(predicted->octave)];
    image.grid.Find(features, predicted->pixel_px, radius_px, predicted->octave - 1, predicted->octave + 1, &near);
    Claim claim{Nearest(landmarks[i]->descriptor, features, near), is_expected, cell};
    if (claim.distance > options.max_distance) continue;
    claim.landmark = i;
    const Eigen::Vector2d offset_px = features.pixels_px[claim.feature].cast<double>() - predicted->pixel_px;
    claim.error_px = offset_px.norm() / scales[features.octaves[claim.feature]];
    if (claim.distance < claims[claim.feature].distance) claims[claim.feature] = claim;
  }
  Settle(claims, &result);
  return result;
}

}  // namespace portolan
