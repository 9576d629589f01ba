#include "map/map_io.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>

#include "base/hash.h"
#include "base/random.h"
#include "map/map.h"
#include "map/map_changes.h"
#include "map/random_edits.h"

namespace portolan {
namespace {

constexpr size_t kHeadBytes = 6;  // mark and version

/// A map after many edits, its snapshot and the data of its keyframes.
struct Example {
  Map map{MapId(40000, 1, 1), 7};  // ids of robots above 32767 are negative as signed integers
  RandomEdits edits{5, &map};
  MapDelta snapshot;

  Example() {
    for (int i = 0; i < 300; ++i) edits.Next();
    map.SetResidual(map.keyframes().begin()->second.data->camera, {0.02, -0.01});
    static_cast<void>(map.TakeDelta());
    snapshot = map.Snapshot();
  }
  const KeyFrameData& data() const { return *map.keyframes().begin()->second.data; }
};

/// Gives bytes that were tampered with a hash that fits: what the decoder then refuses it refuses by itself.
std::string Reseal(std::string bytes) {
  Hasher hasher;
  const size_t hashed = bytes.size() - sizeof(uint64_t);
  hasher.AddBytes(bytes.data(), hashed);
  const uint64_t hash = hasher.Value();
  return bytes.replace(hashed, sizeof hash, reinterpret_cast<const char*>(&hash), sizeof hash);
}

std::string MessageOf(const Result<KeyFrameData>& result) {
  return result.ok() ? "" : result.error().message;
}
std::string MessageOf(const Result<MapDelta>& result) {
  return result.ok() ? "" : result.error().message;
}

TEST(MapIo, KeyFrameDataComesBackToTheBit) {
  const Example example;
  for (const auto& [id, keyframe] : example.map.keyframes()) {
    KeyFrameData data = *keyframe.data;
    data.stamp = Timestamp{-5};
    data.frame = UINT64_MAX;
    data.features.angles_rad[3] = 1.25f;
    data.residual = {0.03, -0.25};
    const Result<KeyFrameData> back = DecodeKeyFrameData(EncodeKeyFrameData(data));
    ASSERT_TRUE(back.ok()) << MessageOf(back);
    EXPECT_EQ(back->id, data.id);
    EXPECT_EQ(back->stamp, data.stamp);
    EXPECT_EQ(back->frame, data.frame);
    EXPECT_EQ(back->camera, data.camera);
    EXPECT_EQ(back->residual, data.residual);
    EXPECT_EQ(back->pyramid.levels, data.pyramid.levels);
    EXPECT_EQ(back->pyramid.factor, data.pyramid.factor);
    EXPECT_EQ(back->features.pixels_px, data.features.pixels_px);
    EXPECT_EQ(back->features.octaves, data.features.octaves);
    EXPECT_EQ(back->features.angles_rad, data.features.angles_rad);
    EXPECT_EQ(back->features.descriptors, data.features.descriptors);
  }
}

TEST(MapIo, KeyFrameWithoutFeaturesComesBack) {
  KeyFrameData data;
  data.id = KeyFrameId(0, 1, 1);
  data.camera = PinholeCamera{500, 500, 320, 240, 640, 480};
  const Result<KeyFrameData> back = DecodeKeyFrameData(EncodeKeyFrameData(data));
  ASSERT_TRUE(back.ok()) << MessageOf(back);
  EXPECT_EQ(back->features.size(), 0u);
}

TEST(MapIo, SnapshotComesBackAsAnEqualMap) {
  const Example example;
  const std::string bytes = EncodeSnapshot(example.snapshot);
  const Result<MapDelta> back = DecodeSnapshot(bytes);
  ASSERT_TRUE(back.ok()) << MessageOf(back);
  Map replica(example.map.id());
  const Status applied = replica.Apply(*back, example.edits.FindData());
  ASSERT_TRUE(applied.ok()) << applied.error().message;
  EXPECT_EQ(HashMap(replica), HashMap(example.map));
  EXPECT_EQ(replica.epoch(), example.map.epoch());
  EXPECT_EQ(replica.revision(), example.map.revision());
  EXPECT_EQ(EncodeSnapshot(*back), bytes);
}

/// With all that a change may have in it.
MapDelta MakeChange(Example* example) {
  for (int i = 0; i < 200; ++i) example->edits.Next();
  for (int i = 0; i < 20; ++i) {  // removals from points that stay
    example->edits.Edit(RandomEdits::kAddPoint);
    for (int k = 0; k < 10; ++k) example->edits.Edit(RandomEdits::kAddObservation);
    example->edits.Edit(RandomEdits::kRemoveObservation);
  }
  MapDelta change = example->map.TakeDelta();
  const auto removes = [](const auto& o) { return o.feature < 0; };
  EXPECT_FALSE(change.removed_points.empty() || change.removed_keyframes.empty()) << "the example removes both";
  EXPECT_TRUE(std::any_of(change.observations.begin(), change.observations.end(), removes));
  return change;
}

TEST(MapIo, ChangeComesBackAndMakesTheSameMap) {
  Example example;
  Map replica(example.map.id());
  ASSERT_TRUE(replica.Apply(example.snapshot, example.edits.FindData()).ok());
  const MapDelta change = MakeChange(&example);
  const std::string bytes = EncodeChange(change);
  const Result<MapDelta> back = DecodeChange(bytes);
  ASSERT_TRUE(back.ok()) << MessageOf(back);
  EXPECT_EQ(EncodeChange(*back), bytes);
  EXPECT_EQ(back->removed_keyframes.back().anchor, change.removed_keyframes.back().anchor);
  EXPECT_EQ(back->removed_points.back().replaced_by, change.removed_points.back().replaced_by);
  const Status applied = replica.Apply(*back, example.edits.FindData());
  ASSERT_TRUE(applied.ok()) << applied.error().message;
  EXPECT_EQ(HashMap(replica), HashMap(example.map));
  EXPECT_EQ(replica.revision(), example.map.revision());
}

TEST(MapIo, RefusesChangesOutOfRange) {
  Example example;
  const MapDelta sound = MakeChange(&example);
  const auto refused = [&](auto spoil) {
    MapDelta change = sound;
    spoil(&change);
    return !DecodeChange(EncodeChange(change)).ok();
  };
  EXPECT_TRUE(refused([](MapDelta* d) { d->map = MapId(); }));
  EXPECT_TRUE(refused([](MapDelta* d) { d->residuals[0].residual.k1 = 1.5; }));
  EXPECT_TRUE(refused([](MapDelta* d) { d->removed_points[0].id = MapPointId(); }));
  EXPECT_TRUE(refused([](MapDelta* d) { d->removed_keyframes[0].id = KeyFrameId(); }));
  EXPECT_TRUE(refused([](MapDelta* d) { d->removed_keyframes[0].removed_from_anchor.translation.z() = NAN; }));
  EXPECT_TRUE(refused([](MapDelta* d) { d->keyframes[0].camera_from_map.translation.x() = NAN; }));
  EXPECT_TRUE(refused([](MapDelta* d) { d->points[0].position_in_map.y() = INFINITY; }));
  EXPECT_TRUE(refused([](MapDelta* d) { d->observations[0].point = MapPointId(); }));
  EXPECT_FALSE(refused([](MapDelta*) {}));
  std::string backwards = EncodeChange(sound);
  const size_t base_at = kHeadBytes + 2 * sizeof(uint64_t);  // behind map and epoch
  backwards.replace(base_at, sizeof(uint64_t), backwards.substr(base_at + sizeof(uint64_t), sizeof(uint64_t)));
  EXPECT_THAT(MessageOf(DecodeChange(Reseal(backwards))), ::testing::HasSubstr("from revision 2 to 2"));
  EXPECT_THAT(MessageOf(DecodeChange(EncodeSnapshot(example.snapshot))), ::testing::HasSubstr("PDLT"));
}

TEST(MapIo, SnapshotIsCompact) {
  const Example example;
  const size_t plain = example.snapshot.keyframes.size() * 76 + example.snapshot.points.size() * 20 +
                       example.snapshot.observations.size() * 20;
  EXPECT_LT(EncodeSnapshot(example.snapshot).size(), plain / 2 + example.snapshot.keyframes.size() * 40);
}

TEST(MapIo, RefusesEachFlippedBit) {
  const Example example;
  std::string bytes = EncodeSnapshot(example.snapshot);
  Random random(1);
  for (int trial = 0; trial < 300; ++trial) {
    const size_t at = random.Below(bytes.size());
    const char flip = static_cast<char>(1 << random.Below(8));
    bytes[at] ^= flip;
    EXPECT_FALSE(DecodeSnapshot(bytes).ok()) << "byte " << at;
    bytes[at] ^= flip;
  }
  EXPECT_TRUE(DecodeSnapshot(bytes).ok());
}

TEST(MapIo, RefusesEachLengthButItsOwn) {
  const Example example;
  const std::string bytes = EncodeKeyFrameData(example.data());
  for (size_t size = 0; size < bytes.size(); ++size)
    ASSERT_FALSE(DecodeKeyFrameData(bytes.substr(0, size)).ok()) << size;
  EXPECT_FALSE(DecodeKeyFrameData(bytes + '\0').ok());
  EXPECT_NE(MessageOf(DecodeKeyFrameData(Reseal(bytes + std::string(8, '\0')))), "");
  EXPECT_NE(MessageOf(DecodeKeyFrameData(Reseal(bytes.substr(0, bytes.size() - 1)))), "");
}

TEST(MapIo, NamesWhatIsWrong) {
  const Example example;
  const std::string bytes = EncodeKeyFrameData(example.data());
  EXPECT_NE(MessageOf(DecodeSnapshot(bytes)).find("PMAP"), std::string::npos);
  // Also of form 1, which had no residuals: it was never released.
  for (const char form : {'\1', '\3'}) {
    std::string other = bytes;
    other[4] = form;
    EXPECT_NE(MessageOf(DecodeKeyFrameData(Reseal(other)))
                  .find("form " + std::to_string(form) + ", this program reads form 2"),
              std::string::npos);
    std::string state = EncodeSnapshot(example.snapshot);
    state[4] = form;
    EXPECT_NE(MessageOf(DecodeSnapshot(Reseal(state))).find("form " + std::to_string(form)), std::string::npos);
  }
  std::string damaged = bytes;
  damaged[kHeadBytes + 50] ^= 1;
  EXPECT_NE(MessageOf(DecodeKeyFrameData(damaged)).find("damaged"), std::string::npos);
}

TEST(MapIo, RefusesValuesOutOfRange) {
  const Example example;
  const auto refused = [&](auto change) {
    KeyFrameData data = example.data();
    change(&data);
    return !DecodeKeyFrameData(EncodeKeyFrameData(data)).ok();
  };
  EXPECT_TRUE(refused([](KeyFrameData* d) { d->id = KeyFrameId(); }));
  EXPECT_TRUE(refused([](KeyFrameData* d) { d->camera.fx = NAN; }));
  EXPECT_TRUE(refused([](KeyFrameData* d) { d->camera.fy = -1; }));
  EXPECT_TRUE(refused([](KeyFrameData* d) { d->camera.width = 0; }));
  EXPECT_TRUE(refused([](KeyFrameData* d) { d->camera.height = 1 << 30; }));
  EXPECT_TRUE(refused([](KeyFrameData* d) { d->pyramid.levels = 0; }));
  EXPECT_TRUE(refused([](KeyFrameData* d) { d->pyramid.factor = 1; }));
  EXPECT_TRUE(refused([](KeyFrameData* d) { d->residual.k2 = NAN; }));
  EXPECT_TRUE(refused([](KeyFrameData* d) { d->features.octaves[0] = 8; }));
  EXPECT_TRUE(refused([](KeyFrameData* d) { d->features.pixels_px[1].x() = 640; }));
  EXPECT_TRUE(refused([](KeyFrameData* d) { d->features.pixels_px[1].y() = NAN; }));
  EXPECT_TRUE(refused([](KeyFrameData* d) { d->features.angles_rad[2] = INFINITY; }));
  EXPECT_FALSE(refused([](KeyFrameData*) {}));
}

TEST(MapIo, RefusesSnapshotsOutOfRange) {
  const Example example;
  const auto refused = [&](auto change) {
    MapDelta snapshot = example.snapshot;
    change(&snapshot);
    return !DecodeSnapshot(EncodeSnapshot(snapshot)).ok();
  };
  EXPECT_TRUE(refused([](MapDelta* d) { d->map = MapId(); }));
  EXPECT_TRUE(refused([](MapDelta* d) { d->residuals[0].residual.k1 = 1.5; }));
  EXPECT_TRUE(refused([](MapDelta* d) { d->residuals[0].camera.fx = 0; }));
  EXPECT_TRUE(refused([](MapDelta* d) { d->keyframes[0].camera_from_map.rotation.w() += 0.1; }));
  EXPECT_TRUE(refused([](MapDelta* d) { d->keyframes[0].camera_from_map.translation.x() = NAN; }));
  EXPECT_TRUE(refused([](MapDelta* d) { d->keyframes[1].id = KeyFrameId(); }));
  EXPECT_TRUE(refused([](MapDelta* d) { d->points[0].position_in_map.y() = INFINITY; }));
  EXPECT_TRUE(refused([](MapDelta* d) { d->points[0].id = MapPointId(); }));
  EXPECT_TRUE(refused([](MapDelta* d) { d->observations[0].keyframe = KeyFrameId(); }));
  EXPECT_FALSE(refused([](MapDelta*) {}));
}

/// Random changes under a hash that fits: whatever comes, an error or values in range, no crash and no great
/// allocation.
TEST(MapIo, SurvivesRandomBytesUnderARightHash) {
  Example example;
  const std::string keyframe = EncodeKeyFrameData(example.data()), snapshot = EncodeSnapshot(example.snapshot);
  Map before(example.map.id());
  ASSERT_TRUE(before.Apply(example.snapshot, example.edits.FindData()).ok());
  const std::string change = EncodeChange(MakeChange(&example));
  Random random(2);
  int refused = 0;
  for (int trial = 0; trial < 3000; ++trial) {
    std::string a = keyframe, b = snapshot, c = change;
    for (std::string* bytes : {&a, &b, &c}) {
      const uint64_t changes = 1 + random.Below(8);
      for (uint64_t i = 0; i < changes; ++i) {
        // Half of them at the front, where the counts stand.
        const size_t range = random.Below(2) == 0 ? 40 : bytes->size() - kHeadBytes;
        (*bytes)[kHeadBytes + random.Below(range)] = static_cast<char>(random.Next());
      }
      if (random.Below(4) == 0) bytes->resize(kHeadBytes + 8 + random.Below(bytes->size() - kHeadBytes - 8));
    }
    const Result<KeyFrameData> data = DecodeKeyFrameData(Reseal(a));
    const Result<MapDelta> delta = DecodeSnapshot(Reseal(b));
    const Result<MapDelta> later = DecodeChange(Reseal(c));
    refused += !data.ok() + !delta.ok() + !later.ok();
    if (data.ok()) MakeKeyFrameData(*data, nullptr);
    if (later.ok()) {
      static_cast<void>(MergeChanges(example.snapshot, {*later}).ok());
      Map map = before;
      static_cast<void>(map.Apply(*later, example.edits.FindData()).ok());
    }
    if (!delta.ok()) continue;
    Map map(delta->map);
    static_cast<void>(map.Apply(*delta, example.edits.FindData()).ok());
  }
  EXPECT_GT(refused, 1000);
}

TEST(MapIo, SurvivesPlainNoise) {
  Random random(3);
  for (int trial = 0; trial < 1000; ++trial) {
    std::string bytes(random.Below(200), '\0');
    for (char& byte : bytes) byte = static_cast<char>(random.Next());
    EXPECT_FALSE(DecodeKeyFrameData(bytes).ok());
    EXPECT_FALSE(DecodeSnapshot(bytes).ok());
    EXPECT_FALSE(DecodeChange(bytes).ok());
  }
}

}  // namespace
}  // namespace portolan
