#include "testing/synthetic_scene.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>

#include "base/check.h"

namespace portolan {
namespace {

constexpr double kFarFactor = 1000;  // of the depth: parallax below a hundredth of a pixel
constexpr double kViewsPerSecond = 5;

/// A place of the circular street: `way` along it, `aside` outwards from its middle, `height` up.
Eigen::Vector3d PlaceInStreet(const SyntheticSceneOptions& options, double way, double aside, double height) {
  const double radius = options.lap / (2 * M_PI), angle = way / radius;
  return {radius - (radius + aside) * std::cos(angle), -height, (radius + aside) * std::sin(angle)};
}

Eigen::Vector3d DrawInStreet(const SyntheticSceneOptions& options, Random* random) {
  const double way = random->Uniform(0, options.lap), side = random->Uniform() < 0.5 ? -1 : 1;
  const double aside = side * random->Uniform(0.2, 0.6) * options.depth;
  return PlaceInStreet(options, way, aside, random->Uniform(-0.3, 0.3) * options.depth);
}

std::vector<Eigen::Vector3d> MakeLandmarks(const SyntheticSceneOptions& options, Random* random) {
  const double depth = options.depth;
  const Eigen::Vector3d middle(0, 0, depth);
  std::vector<Eigen::Vector3d> landmarks;
  for (int i = 0; i < options.num_landmarks; ++i) {
    if (options.landmarks == LandmarkLayout::kStreet) {
      landmarks.push_back(DrawInStreet(options, random));
      continue;
    }
    const double x = random->Uniform(-0.8, 0.8), y = random->Uniform(-0.5, 0.5), z = random->Uniform(-0.5, 0.5);
    switch (options.landmarks) {
      case LandmarkLayout::kGeneral:
        landmarks.push_back(middle + depth * Eigen::Vector3d(x, y, z));
        break;
      case LandmarkLayout::kPlanar:
        landmarks.push_back(middle + depth * Eigen::Vector3d(x, y, 0.3 * x + 0.1 * y));
        break;
      case LandmarkLayout::kFar:
        landmarks.push_back(kFarFactor * (middle + depth * Eigen::Vector3d(x, y, z)));
        break;
      case LandmarkLayout::kStreet:
        break;  // drawn above
    }
  }
  return landmarks;
}

/// @param share of the way, 0 to 1.
Rigid3d MakePose(const SyntheticSceneOptions& options, double share) {
  const Eigen::Vector3d middle(0, 0, options.depth);
  const double way = share * options.travel, angle = way / options.depth;
  switch (options.motion) {
    case CameraMotion::kSideways:
      return LookAt({way, 0.05 * way, 0}, middle);
    case CameraMotion::kForward:
      return LookAt({0.02 * way, 0, way}, middle + Eigen::Vector3d(0.02 * way, 0, options.depth));
    case CameraMotion::kOrbit:
      return LookAt(middle + options.depth * Eigen::Vector3d(std::sin(angle), 0, -std::cos(angle)), middle);
    case CameraMotion::kStreetLap:
      return LookAt(PlaceInStreet(options, way, 0, 0), PlaceInStreet(options, way + 0.5 * options.depth, 0, 0));
    case CameraMotion::kPureRotation:
      return LookAt(Eigen::Vector3d::Zero(), options.depth * Eigen::Vector3d(std::sin(angle), 0, std::cos(angle)));
  }
  PORTOLAN_CHECK(false) << " motion " << static_cast<int>(options.motion);
  return {};
}

Descriptor FlipBits(Descriptor descriptor, double ratio, Random* random) {
  if (ratio <= 0) return descriptor;
  for (uint64_t& word : descriptor) {
    for (int bit = 0; bit < 64; ++bit) {
      if (random->Uniform() < ratio) word ^= uint64_t{1} << bit;
    }
  }
  return descriptor;
}

/// Distance from which a landmark is seen first, or about that.
double FirstDistance(const SyntheticSceneOptions& options, const Eigen::Vector3d& landmark_in_world) {
  return options.landmarks == LandmarkLayout::kStreet ? options.depth : landmark_in_world.norm();
}

/// What a landmark looks like wherever it is seen from.
struct Appearance {
  double max_distance;  // from which it is found at level 0
  float angle_rad;
};

/// Draws the features of one view.
class ViewMaker {
 public:
  ViewMaker(const SyntheticScene& scene, const std::vector<Appearance>& appearances, Random* random)
      : scene_(scene), appearances_(appearances), random_(random) {}

  SyntheticView Make(int number, const Rigid3d& camera_from_world) {
    const SyntheticSceneOptions& options = scene_.options;
    view_.camera_from_world = camera_from_world;
    for (int landmark = 0; landmark < options.num_landmarks; ++landmark) AddLandmark(landmark);
    for (int i = 0; i < options.num_clutter; ++i) {
      const uint8_t octave = static_cast<uint8_t>(random_->Below(static_cast<uint64_t>(data_.pyramid.levels)));
      const float angle = static_cast<float>(random_->Uniform(0, 2 * M_PI));
      Append(RandomPixel(), octave, angle, RandomDescriptor(random_), kNoLandmark, false);
    }
    Shuffle();
    data_.id = KeyFrameId(options.robot, options.session, static_cast<uint32_t>(number) + 1);
    data_.stamp = Timestamp::FromSeconds(number / kViewsPerSecond);
    data_.frame = static_cast<uint64_t>(number);
    data_.camera = options.camera;
    view_.data = MakeKeyFrameData(std::move(data_), nullptr);
    return std::move(view_);
  }

 private:
  Eigen::Vector2d RandomPixel() {
    const PinholeCamera& camera = scene_.options.camera;
    return {random_->Uniform(0, camera.width - 1), random_->Uniform(0, camera.height - 1)};
  }

  void AddLandmark(int landmark) {
    const SyntheticSceneOptions& options = scene_.options;
    const Eigen::Vector3d point = view_.camera_from_world * scene_.landmarks_in_world[static_cast<size_t>(landmark)];
    if (point.z() <= 0 || (options.sight > 0 && point.norm() > options.sight)) return;
    const Appearance& appearance = appearances_[static_cast<size_t>(landmark)];
    const double level = std::log(appearance.max_distance / point.norm()) / std::log(data_.pyramid.factor);
    const int octave = static_cast<int>(std::lround(std::clamp(level, 0.0, data_.pyramid.levels - 1.0)));
    const double sigma = options.pixel_sigma_px * data_.pyramid.Scale(octave);
    Eigen::Vector2d pixel =
        options.camera.Project(point) + sigma * Eigen::Vector2d(random_->Gaussian(), random_->Gaussian());
    const bool outlier = random_->Uniform() < options.outlier_ratio;
    if (!options.camera.Contains(pixel)) return;
    if (outlier) pixel = RandomPixel();
    const Descriptor& descriptor = scene_.descriptors[static_cast<size_t>(landmark)];
    Append(pixel, static_cast<uint8_t>(octave), appearance.angle_rad,
           FlipBits(descriptor, options.descriptor_flip_ratio, random_), landmark, outlier);
  }

  void Append(const Eigen::Vector2d& pixel, uint8_t octave, float angle, const Descriptor& descriptor, int landmark,
              bool outlier) {
    data_.features.pixels_px.push_back(pixel.cast<float>());
    data_.features.octaves.push_back(octave);
    data_.features.angles_rad.push_back(angle);
    data_.features.descriptors.push_back(descriptor);
    view_.landmark_of_feature.push_back(landmark);
    view_.is_outlier.push_back(outlier);
  }

  void SwapFeatures(size_t i, size_t j) {
    FeatureSet& features = data_.features;
    std::swap(features.pixels_px[i], features.pixels_px[j]);
    std::swap(features.octaves[i], features.octaves[j]);
    std::swap(features.angles_rad[i], features.angles_rad[j]);
    std::swap(features.descriptors[i], features.descriptors[j]);
    std::swap(view_.landmark_of_feature[i], view_.landmark_of_feature[j]);
    std::vector<bool>::swap(view_.is_outlier[i], view_.is_outlier[j]);
  }

  /// Feature numbers must not tell the landmark (Fisher and Yates).
  void Shuffle() {
    for (size_t i = data_.features.size(); i > 1; --i) SwapFeatures(i - 1, random_->Below(i));
  }

  const SyntheticScene& scene_;
  const std::vector<Appearance>& appearances_;
  Random* random_;
  SyntheticView view_;
  KeyFrameData data_;
};

}  // namespace

size_t SyntheticScene::ViewOf(KeyFrameId id) const {
  for (size_t i = 0; i < views.size(); ++i) {
    if (views[i].data->id == id) return i;
  }
  PORTOLAN_CHECK(false) << " no view is keyframe " << id;
  return 0;
}

SyntheticScene MakeSyntheticScene(const SyntheticSceneOptions& options) {
  PORTOLAN_CHECK(options.num_landmarks >= 0 && options.num_views > 0 && options.depth > 0);
  Random random(options.seed);
  SyntheticScene scene;
  scene.options = options;
  scene.landmarks_in_world = MakeLandmarks(options, &random);
  std::vector<Appearance> appearances;
  for (const Eigen::Vector3d& landmark : scene.landmarks_in_world) {
    scene.descriptors.push_back(RandomDescriptor(&random));
    // Found at level 0 to 5 from the first camera, so that coming closer or going back a little loses none.
    appearances.push_back({FirstDistance(options, landmark) * ScalePyramid().Scale(1) *
                               std::pow(ScalePyramid().factor, random.Uniform(0, 4)),
                           static_cast<float>(random.Uniform(0, 2 * M_PI))});
  }
  for (int i = 0; i < options.num_views; ++i) {
    const double share = options.num_views > 1 ? static_cast<double>(i) / (options.num_views - 1) : 0.0;
    scene.views.push_back(ViewMaker(scene, appearances, &random).Make(i, MakePose(options, share)));
  }
  return scene;
}

std::vector<std::pair<uint32_t, uint32_t>> TrueMatches(const SyntheticView& a, const SyntheticView& b) {
  std::map<int, uint32_t> feature_in_b;
  for (size_t j = 0; j < b.landmark_of_feature.size(); ++j) {
    if (b.landmark_of_feature[j] != kNoLandmark) feature_in_b[b.landmark_of_feature[j]] = static_cast<uint32_t>(j);
  }
  std::vector<std::pair<uint32_t, uint32_t>> matches;
  for (size_t i = 0; i < a.landmark_of_feature.size(); ++i) {
    const auto found = feature_in_b.find(a.landmark_of_feature[i]);
    if (found != feature_in_b.end()) matches.emplace_back(static_cast<uint32_t>(i), found->second);
  }
  return matches;
}

Descriptor RandomDescriptor(Random* random) {
  return {random->Next(), random->Next(), random->Next(), random->Next()};
}

Rigid3d LookAt(const Eigen::Vector3d& eye_in_world, const Eigen::Vector3d& target_in_world) {
  const Eigen::Vector3d z = (target_in_world - eye_in_world).normalized();
  const Eigen::Vector3d x = Eigen::Vector3d::UnitY().cross(z).normalized();
  PORTOLAN_CHECK(x.allFinite() && x.norm() > 0.5) << " a camera can't look straight up or down here";
  Eigen::Matrix3d world_from_camera;
  world_from_camera << x, z.cross(x), z;
  return Rigid3d(Eigen::Quaterniond(world_from_camera), eye_in_world).Inverse();
}

}  // namespace portolan
