#pragma once

#include <map>
#include <memory>
#include <string>
#include <vector>

#include "base/random.h"
#include "map/map.h"

namespace portolan {

/// Changes a map at random, one valid change at a time, as an owner would: for tests of properties that hold after any
/// sequence of changes. Deterministic for a seed.
class RandomEdits {
 public:
  enum Kind {
    kAddKeyFrame,
    kAddPoint,
    kAddObservation,
    kRemoveObservation,
    kMovePoint,
    kMoveKeyFrame,
    kMerge,
    kRemovePoint,
    kRemoveKeyFrame,
    kHang
  };
  static constexpr int kNumKinds = 10;

  /// Begins the map with two keyframes and a few points. @param session of all ids.
  RandomEdits(uint64_t seed, Map* map, uint32_t session = 1) : random_(seed), map_(*map), session_(session) {
    AddKeyFrame();
    AddKeyFrame();
    for (int i = 0; i < 5; ++i) AddPoint();
  }

  Kind Next() {
    const Kind kind = static_cast<Kind>(random_.Below(kNumKinds));
    Edit(kind);
    return kind;
  }

  void Edit(Kind kind) {
    switch (kind) {
      case kAddKeyFrame:
        return AddKeyFrame();
      case kAddPoint:  // several: most other edits take points away
        for (int i = 0; i < 5; ++i) AddPoint();
        return;
      case kAddObservation:
        map_.AddObservation(SomePoint(), SomeKeyFrame(), SomeFeature());
        return;
      case kRemoveObservation:
        return RemoveObservation();
      case kMovePoint:
        return map_.SetPosition(SomePoint(), SomePosition());
      case kMoveKeyFrame:
        return map_.SetPose(SomeKeyFrame(), SomePose());
      case kMerge:
        return Merge();
      case kRemovePoint:
        return map_.points().size() > kEnough ? map_.RemovePoint(SomePoint()) : AddPoint();
      case kRemoveKeyFrame:
        return RemoveKeyFrame();
      case kHang:
        return Hang();
    }
  }

  Map::FindData FindData() const {
    return [this](KeyFrameId id) {
      const auto found = data_.find(id);
      return found == data_.end() ? nullptr : found->second;
    };
  }
  const std::map<KeyFrameId, std::shared_ptr<const KeyFrameData>>& data() const { return data_; }
  Random* random() { return &random_; }

  KeyFrameId SomeKeyFrame() {
    return std::next(map_.keyframes().begin(), static_cast<ptrdiff_t>(random_.Below(map_.keyframes().size())))->first;
  }
  MapPointId SomePoint() {
    if (map_.points().empty()) AddPoint();
    const auto ids = map_.SortedPointIds();
    return ids[random_.Below(ids.size())];
  }
  uint32_t SomeFeature() { return static_cast<uint32_t>(random_.Below(kFeatures)); }
  Eigen::Vector3f SomePosition() {
    const double x = random_.Gaussian(), y = random_.Gaussian(), z = random_.Uniform(3, 6);
    return Eigen::Vector3d(x, y, z).cast<float>();
  }
  Rigid3d SomePose() {
    const double a = random_.Gaussian(), b = random_.Gaussian(), x = random_.Gaussian(), y = random_.Gaussian();
    return Rigid3d(ExpSO3({0.1 * a, 0.1 * b, 0.02}), {x, y, 0});
  }

  static std::shared_ptr<const KeyFrameData> MakeData(KeyFrameId id, Random* random) {
    KeyFrameData data;
    data.id = id;
    data.camera = PinholeCamera{500, 500, 319.5, 239.5, 640, 480};
    for (uint64_t i = 0; i < kFeatures; ++i) {
      const double x = random->Uniform(0, 639), y = random->Uniform(0, 479);
      data.features.pixels_px.push_back(Eigen::Vector2d(x, y).cast<float>());
      data.features.octaves.push_back(static_cast<uint8_t>(random->Below(8)));
      data.features.angles_rad.push_back(0);
      data.features.descriptors.push_back({random->Next(), random->Next(), random->Next(), random->Next()});
    }
    return MakeKeyFrameData(std::move(data), nullptr);
  }

  static constexpr uint64_t kFeatures = 30;

 private:
  static constexpr size_t kEnough = 10;  // points that random removals leave

  void AddKeyFrame() {
    const KeyFrameId id(0, session_, ++last_keyframe_);
    data_[id] = MakeData(id, &random_);
    const KeyFrameId parent = map_.keyframes().empty() ? KeyFrameId() : SomeKeyFrame();
    map_.AddKeyFrame(data_[id], SomePose(), parent);
  }

  void AddPoint() {
    const MapPointId id(0, session_, ++last_point_);
    map_.AddPoint(id, SomePosition());
    for (int tries = 0; tries < 8; ++tries) map_.AddObservation(id, SomeKeyFrame(), SomeFeature());
    if (map_.point(id).observations.size() < 2) map_.RemovePoint(id);
  }

  void RemoveObservation() {
    const MapPointId id = SomePoint();
    const auto& observations = map_.point(id).observations;
    if (observations.size() <= 2) return AddPoint();
    map_.RemoveObservation(id, observations[random_.Below(observations.size())].keyframe);
  }

  void Merge() {
    const MapPointId from = SomePoint(), into = SomePoint();
    if (from != into && map_.points().size() > kEnough) map_.MergePoints(from, into);
  }

  void RemoveKeyFrame() {
    const KeyFrameId id = SomeKeyFrame();
    if (map_.keyframes().size() <= 3 || !map_.keyframe(id).parent.IsValid()) return AddKeyFrame();
    map_.RemoveKeyFrame(id);
  }

  /// Hangs a keyframe on another that does not hang on it.
  void Hang() {
    const KeyFrameId id = SomeKeyFrame(), parent = SomeKeyFrame();
    for (KeyFrameId above = parent; above.IsValid(); above = map_.keyframe(above).parent) {
      if (above == id) return;
    }
    if (map_.keyframe(id).parent.IsValid()) map_.SetParent(id, parent);
  }

  Random random_;
  Map& map_;
  uint32_t session_;
  std::map<KeyFrameId, std::shared_ptr<const KeyFrameData>> data_;
  uint32_t last_keyframe_ = 0, last_point_ = 0;
};

}  // namespace portolan
