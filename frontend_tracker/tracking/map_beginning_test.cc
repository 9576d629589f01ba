#include "tracking/map_beginning.h"

#include <gmock/gmock.h>

#include "tracking/synthetic_frame.h"

namespace portolan {
namespace {

using ::testing::ElementsAreArray;
using ::testing::IsEmpty;
using ::testing::SizeIs;

const MapId kMap(0, 1, 1);

SyntheticScene SidewaysScene(int num_views) {
  SyntheticSceneOptions options;
  options.num_views = num_views;
  options.travel = 0.05 * num_views;
  return MakeSyntheticScene(options);
}

template <class Frames>
std::vector<uint64_t> NumbersOf(const Frames& frames) {
  std::vector<uint64_t> numbers;
  for (const Frame& frame : frames) numbers.push_back(frame.number);
  return numbers;
}

std::vector<uint64_t> Range(uint64_t from, uint64_t to) {
  std::vector<uint64_t> numbers;
  for (uint64_t i = from; i < to; ++i) numbers.push_back(i);
  return numbers;
}

class MapBeginningTest : public ::testing::Test {
 protected:
  MapBeginningTest() { beginning_.Start(kMap); }

  std::optional<Initializer::Pair> Offer(const SyntheticScene& scene, size_t view) {
    const auto rotation = [&](size_t of) { return scene.views[of].camera_from_world.rotation; };
    return beginning_.Offer(FrameOfView(scene, view), rotation(view) * rotation(view > 0 ? view - 1 : 0).conjugate());
  }
  /// Offers views from the given one until a pair is complete, and notes it as sent. @return the view after it.
  size_t SendPair(size_t view = 0) {
    for (; view < scene_.views.size(); ++view) {
      std::optional<Initializer::Pair> pair = Offer(scene_, view);
      if (!pair) continue;
      beginning_.NoteSent(pair->first, pair->second);
      return view + 1;
    }
    ADD_FAILURE() << "no pair";
    return view;
  }

  const SyntheticScene scene_ = SidewaysScene(60);
  MapBeginning beginning_{InitializerOptions()};
};

TEST_F(MapBeginningTest, HandsOutThePairAndTheFramesAroundIt) {
  const size_t next = SendPair();
  ASSERT_GT(next, 3u);
  for (size_t view = next; view < next + 5; ++view) EXPECT_FALSE(Offer(scene_, view)) << "one pair at a time";
  const MapBeginning::Frames frames = beginning_.Take();
  EXPECT_EQ(frames.first.number, 0u);
  EXPECT_EQ(frames.second.number, next - 1);
  EXPECT_THAT(NumbersOf(frames.between), ElementsAreArray(Range(1, next - 1)));
  EXPECT_THAT(NumbersOf(frames.since), ElementsAreArray(Range(next, next + 5)));
  EXPECT_FALSE(beginning_.map().IsValid());
  EXPECT_FALSE(beginning_.sent());
}

TEST_F(MapBeginningTest, IsMadeOnceTheMapHasBothKeyFrames) {
  EXPECT_FALSE(beginning_.IsMade(Map(kMap)));
  SendPair();
  Map map(kMap);
  EXPECT_FALSE(beginning_.IsMade(map));
  map.AddKeyFrame(beginning_.sent()->first.data, Rigid3d(), KeyFrameId());
  EXPECT_FALSE(beginning_.IsMade(map));
  map.AddKeyFrame(beginning_.sent()->second.data, Rigid3d(), beginning_.sent()->first.data->id);
  EXPECT_TRUE(beginning_.IsMade(map));
}

TEST_F(MapBeginningTest, AfterARefusalTheSameFirstFrameGoesOn) {
  const size_t refused = SendPair();
  EXPECT_FALSE(Offer(scene_, refused));  // while the mapper looks at the pair
  beginning_.DropSent();
  EXPECT_EQ(beginning_.map(), kMap);
  const size_t next = SendPair(refused + 1);
  EXPECT_EQ(next, refused + 2) << "the very next frame makes a pair";
  const MapBeginning::Frames frames = beginning_.Take();
  EXPECT_EQ(frames.first.number, 0u);
  EXPECT_EQ(frames.second.number, refused + 1);
  EXPECT_THAT(frames.since, IsEmpty());
}

TEST_F(MapBeginningTest, ANewFirstFrameForgetsThoseBeforeIt) {
  SyntheticSceneOptions elsewhere = scene_.options;
  elsewhere.seed = 2;
  const SyntheticScene other = MakeSyntheticScene(elsewhere);
  EXPECT_FALSE(Offer(other, 0));
  EXPECT_FALSE(Offer(other, 1));
  const size_t next = SendPair(2);  // shows something else: the new first
  const MapBeginning::Frames frames = beginning_.Take();
  EXPECT_EQ(frames.first.number, 2u);
  EXPECT_THAT(NumbersOf(frames.between), ElementsAreArray(Range(3, next - 1)));
}

TEST_F(MapBeginningTest, KeepsABoundedNumberOfFramesWhileTheMapperWorks) {
  const size_t next = SendPair();
  for (size_t i = 0; i < 100; ++i) EXPECT_FALSE(Offer(scene_, next));
  EXPECT_THAT(beginning_.Take().since, SizeIs(30));
}

TEST_F(MapBeginningTest, QueuedFramesAreOfferedInPartsAndOldOnesCompleteNoPair) {
  const auto rotation = [&](size_t view) { return scene_.views[view].camera_from_world.rotation; };
  for (size_t view = 0; view < 40; ++view) {
    const Eigen::Quaterniond turn = rotation(view) * rotation(view > 0 ? view - 1 : 0).conjugate();
    beginning_.Queue(FrameOfView(scene_, view), turn, view >= 30);
  }
  EXPECT_FALSE(beginning_.OfferQueued(25)) << "far enough apart, but past";
  EXPECT_FALSE(beginning_.OfferQueued(5));
  std::optional<Initializer::Pair> pair = beginning_.OfferQueued(25);
  ASSERT_TRUE(pair);
  EXPECT_EQ(pair->second.number, 30u) << "the first that may";
  // What is still queued came since.
  beginning_.NoteSent(pair->first, pair->second);
  EXPECT_TRUE(beginning_.any_sent());
  const MapBeginning::Frames frames = beginning_.Take();
  EXPECT_THAT(NumbersOf(frames.since), ElementsAreArray(Range(31, 40)));
}

TEST_F(MapBeginningTest, StopForgetsEverything) {
  const size_t next = SendPair();
  beginning_.Stop();
  EXPECT_FALSE(beginning_.map().IsValid());
  EXPECT_FALSE(beginning_.sent());
  beginning_.Start(kMap);
  EXPECT_FALSE(Offer(scene_, next)) << "the first frame of another beginning";
}

}  // namespace
}  // namespace portolan
