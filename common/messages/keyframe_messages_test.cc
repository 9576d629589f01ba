#include "messages/keyframe_messages.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>

#include "features/feature_quantization.h"
#include "messages/malformed_messages.h"
#include "messages/random_messages.h"

namespace portolan {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

void ExpectSameFeatures(const FeatureSet& a, const FeatureSet& b) {
  EXPECT_TRUE(a.pixels_px == b.pixels_px);
  EXPECT_EQ(a.octaves, b.octaves);
  EXPECT_EQ(a.angles_rad, b.angles_rad);
  EXPECT_EQ(a.descriptors, b.descriptors);
}

TEST(KeyFrameMessagesTest, AQuantisedKeyFrameComesBackToTheBit) {
  Random random(1);
  for (const size_t n : {size_t{0}, size_t{1}, size_t{2000}}) {
    const KeyFrameMessage sent = RandomKeyFrame(n, &random);
    const Result<KeyFrameMessage> received = FromWire(ToWire(sent));
    ASSERT_TRUE(received.ok()) << received.error().message;
    EXPECT_EQ(received->data.id, sent.data.id);
    EXPECT_EQ(received->data.stamp, sent.data.stamp);
    EXPECT_EQ(received->data.frame, sent.data.frame);
    EXPECT_EQ(received->data.camera, sent.data.camera);
    EXPECT_EQ(received->data.residual, sent.data.residual);
    EXPECT_EQ(received->data.pyramid.levels, sent.data.pyramid.levels);
    EXPECT_EQ(received->data.pyramid.factor, sent.data.pyramid.factor);
    ExpectSameFeatures(received->data.features, sent.data.features);
    EXPECT_EQ(received->kind, sent.kind);
    EXPECT_EQ(received->vocabulary_hash, sent.vocabulary_hash);
    EXPECT_EQ(received->map, sent.map);
    EXPECT_EQ(received->reference, sent.reference);
    EXPECT_EQ(received->camera_from_map.rotation.coeffs(), sent.camera_from_map.rotation.coeffs());
    EXPECT_EQ(received->camera_from_map.translation, sent.camera_from_map.translation);
    EXPECT_EQ(received->landmarks, sent.landmarks);
  }
}

TEST(KeyFrameMessagesTest, AnInitialPairComesBack) {
  Random random(2);
  KeyFrameMessage sent = RandomKeyFrame(10, &random);
  sent.kind = KeyFrameKind::kInitialSecond;
  sent.map = MapId();
  sent.landmarks.clear();
  sent.initial_matches = {{19999, 0}, {3, 9}, {3, 4}};
  const Result<KeyFrameMessage> received = FromWire(ToWire(sent));
  ASSERT_TRUE(received.ok()) << received.error().message;
  EXPECT_EQ(received->kind, KeyFrameKind::kInitialSecond);
  EXPECT_EQ(received->initial_matches, sent.initial_matches);
}

TEST(KeyFrameMessagesTest, AFeatureCosts39Bytes) {
  Random random(3);
  KeyFrameMessage message = RandomKeyFrame(2000, &random);
  message.landmarks.clear();
  const size_t with = wire::KeyFrame::getCdrSerializedSize(ToWire(message));
  message.data.features = FeatureSet();
  const size_t without = wire::KeyFrame::getCdrSerializedSize(ToWire(message));
  EXPECT_EQ(with - without, 2000u * 39u);
}

TEST(KeyFrameMessagesTest, RefusesWhatIsMalformedAndSaysWhy) {
  const std::vector<Malformed<wire::KeyFrame>> cases = {
      {"id is none", [](wire::KeyFrame* w) { w->id(0); }},
      {"kind is 5", [](wire::KeyFrame* w) { w->kind(5); }},
      {"map of a tracked keyframe is none", [](wire::KeyFrame* w) { w->map_id(0); }},
      {"reference of an initial", [](wire::KeyFrame* w) { w->kind(2), w->reference(0); }},
      {"quaternion of norm", [](wire::KeyFrame* w) { w->camera_from_map().rotation()[3] += 2.0; }},
      {"quaternion of norm", [](wire::KeyFrame* w) { w->camera_from_map().rotation()[0] = kNaN; }},
      {"camera_from_map is not finite", [](wire::KeyFrame* w) { w->camera_from_map().translation()[1] = kNaN; }},
      {"camera.fx", [](wire::KeyFrame* w) { w->camera().fx(-1); }},
      {"camera.fy", [](wire::KeyFrame* w) { w->camera().fy(kNaN); }},
      {"camera.cx", [](wire::KeyFrame* w) { w->camera().cx(kNaN); }},
      {"residual.k2 is", [](wire::KeyFrame* w) { w->residual().k2(kNaN); }},
      {"camera has no size", [](wire::KeyFrame* w) { w->camera().width(0); }},
      {"camera.height is 4000000000", [](wire::KeyFrame* w) { w->camera().height(4000000000u); }},
      {"pyramid has no level", [](wire::KeyFrame* w) { w->pyramid_levels(0); }},
      {"pyramid_levels is 200", [](wire::KeyFrame* w) { w->pyramid_levels(200); }},
      {"pyramid_factor", [](wire::KeyFrame* w) { w->pyramid_factor(1.0); }},
      {"steps_per_pixel is 31", [](wire::KeyFrame* w) { w->steps_per_pixel(31); }},
      {"y_steps has 9 elements, 10 expected", [](wire::KeyFrame* w) { w->y_steps().pop_back(); }},
      {"octaves has", [](wire::KeyFrame* w) { w->octaves().pop_back(); }},
      {"angle_steps has", [](wire::KeyFrame* w) { w->angle_steps().push_back(0); }},
      {"descriptors has 319", [](wire::KeyFrame* w) { w->descriptors().pop_back(); }},
      {"octave is not a level", [](wire::KeyFrame* w) { w->octaves()[9] = 8; }},
      {"outside the image", [](wire::KeyFrame* w) { w->x_steps()[0] = 1240 * 32 + 1; }},
      {"outside the image", [](wire::KeyFrame* w) { w->y_steps()[9] = 375 * 32 + 1; }},
      {"landmark_features has", [](wire::KeyFrame* w) { w->landmark_features().pop_back(); }},
      {"landmarks holds an id that is none", [](wire::KeyFrame* w) { w->landmarks()[1] = 0; }},
      {"landmark's feature is out of range", [](wire::KeyFrame* w) { w->landmark_features()[1] = 10; }},
      {"a feature has two landmarks", [](wire::KeyFrame* w) { w->landmark_features()[1] = w->landmark_features()[0]; }},
      {"match_reference_features has", [](wire::KeyFrame* w) { w->match_own_features().push_back(1); }},
      {"match's feature is out of range",
       [](wire::KeyFrame* w) { w->match_own_features({10}), w->match_reference_features({0}); }},
      {"feature in the reference",
       [](wire::KeyFrame* w) { w->match_own_features({1}), w->match_reference_features({20000}); }},
      {"a feature has two matches",
       [](wire::KeyFrame* w) {
         w->match_own_features({1, 1}), w->match_reference_features({1, 2});
       }},
      {"number of features is 20001",
       [](wire::KeyFrame* w) {
         w->x_steps().resize(20001);
         w->y_steps().resize(20001);
         w->octaves().resize(20001);
         w->angle_steps().resize(20001);
         w->descriptors().resize(20001 * 32);
       }},
  };
  Random random(4);
  const wire::KeyFrame good = ToWire(RandomKeyFrame(10, &random));
  ExpectRefused(good, cases);
}

}  // namespace
}  // namespace portolan
