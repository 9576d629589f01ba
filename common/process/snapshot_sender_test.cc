#include "process/snapshot_sender.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "map/map_io.h"
#include "map/random_edits.h"

namespace portolan {
namespace {

constexpr uint64_t kVocabulary = 0x1234;
constexpr double kTickS = 0.1;  // well within the patience with readers that don't acknowledge
const ProcessId kAsker(0, 7, 1), kOther(0, 8, 1);

/// Holds what was written until it is acknowledged, and refuses more than `room`.
template <class T>
class FakeWriter final : public Writer<T> {
 public:
  bool Write(const T& message) override {
    if (unacknowledged_ >= room) return false;
    ++unacknowledged_;
    written.push_back(message);
    return true;
  }
  int MatchedReaders() const override { return 1; }
  void AssertLiveliness() override {}
  bool WaitForAcknowledgments(double /*seconds*/) override {
    if (acknowledges) unacknowledged_ = 0;
    return unacknowledged_ == 0;
  }

  std::vector<T> written;
  size_t room = 1000;
  bool acknowledges = true;

 private:
  size_t unacknowledged_ = 0;
};

class SnapshotSenderTest : public ::testing::Test {
 protected:
  SnapshotSenderTest()
      : map_(MapId(0, 1, 1), 3),
        edits_(1, &map_),
        sender_(
            &keyframes_, &chunks_, kVocabulary,
            [this](MapId id) { return is_here_ && id == map_.id() ? &map_ : nullptr; },
            [this](const KeyFrameData& data) {
              return can_load_ ? Result<KeyFrameData>(data) : Result<KeyFrameData>(Error{"the file is gone"});
            }) {
    for (int i = 0; i < 200; ++i) edits_.Edit(RandomEdits::kAddKeyFrame);
    static_cast<void>(map_.TakeDelta());
  }

  /// Pieces until none follows at once. @return how many.
  int SendAll(double now_s = 0) {
    int pieces = 1;
    while (sender_.SendPiece(now_s)) EXPECT_LT(++pieces, 1000);
    return pieces;
  }
  void Deliver(MapReplica* replica, size_t first_keyframe = 0) const {
    DeltaAssembler assembler;
    for (size_t i = first_keyframe; i < keyframes_.written.size(); ++i)
      replica->AddKeyFrameData(std::make_shared<const KeyFrameData>(keyframes_.written[i].data));
    for (const MapDeltaChunk& chunk : chunks_.written) {
      for (MapDelta& delta : assembler.Add(chunk)) replica->AddDelta(std::move(delta));
    }
    replica->ApplyPending();
  }

  Map map_;
  RandomEdits edits_;
  FakeWriter<KeyFrameMessage> keyframes_;
  FakeWriter<MapDeltaChunk> chunks_;
  bool is_here_ = true, can_load_ = true;
  SnapshotSender sender_;
};

TEST_F(SnapshotSenderTest, AReplicaIsBroughtUpToTheMap) {
  MapReplica replica(map_.id());
  sender_.Add(replica.MakeRequest(kAsker));
  EXPECT_FALSE(sender_.IsIdle());
  EXPECT_TRUE(sender_.IsSending(map_.id()));
  EXPECT_EQ(SendAll(), static_cast<int>((map_.keyframes().size() + SnapshotSender::kKeyFramesAPiece - 1) /
                                        SnapshotSender::kKeyFramesAPiece));
  EXPECT_TRUE(sender_.IsIdle());
  EXPECT_FALSE(sender_.IsSending(map_.id()));
  EXPECT_EQ(sender_.sent(), 1u);
  EXPECT_EQ(keyframes_.written[0].kind, KeyFrameKind::kCopy);
  EXPECT_EQ(keyframes_.written[0].vocabulary_hash, kVocabulary);
  Deliver(&replica);
  EXPECT_EQ(HashMap(replica.map()), HashMap(map_));
  EXPECT_FALSE(sender_.SendPiece(0));
}

TEST_F(SnapshotSenderTest, APieceWaitsForTheAcknowledgementOfTheOneBeforeButNotForEver) {
  sender_.Add(MapReplica(map_.id()).MakeRequest(kAsker));
  keyframes_.acknowledges = false;
  EXPECT_TRUE(sender_.SendPiece(10));
  for (int i = 0; i < 5; ++i) EXPECT_TRUE(sender_.SendPiece(10.5));
  EXPECT_EQ(keyframes_.written.size(), SnapshotSender::kKeyFramesAPiece);
  EXPECT_TRUE(sender_.SendPiece(10 + SnapshotSender::kAckPatienceS));
  EXPECT_EQ(keyframes_.written.size(), 2 * SnapshotSender::kKeyFramesAPiece);
}

TEST_F(SnapshotSenderTest, WhatAFullWriterRefusesIsSentLater) {
  MapReplica replica(map_.id());
  sender_.Add(replica.MakeRequest(kAsker));
  keyframes_.room = 10;
  EXPECT_FALSE(sender_.SendPiece(0));  // to be tried again at the next tick
  EXPECT_FALSE(sender_.IsIdle());
  EXPECT_EQ(keyframes_.written.size(), 10u);
  for (int tick = 1; !sender_.IsIdle() && tick < 100; ++tick) SendAll(tick * kTickS);
  EXPECT_EQ(keyframes_.written.size(), map_.keyframes().size());  // none twice, none left out
  Deliver(&replica);
  EXPECT_EQ(HashMap(replica.map()), HashMap(map_));
}

TEST_F(SnapshotSenderTest, ARefusedChunkOfTheStateIsSentLater) {
  for (int i = 0; i < 1500; ++i) {
    edits_.Edit(RandomEdits::kAddKeyFrame);
    edits_.Edit(RandomEdits::kAddPoint);
  }
  MapReplica replica(map_.id());
  sender_.Add(replica.MakeRequest(kAsker));
  chunks_.room = 1;
  for (int tick = 1; !sender_.IsIdle() && tick < 100; ++tick) SendAll(tick * kTickS);
  EXPECT_GT(chunks_.written.size(), 2u);
  Deliver(&replica);
  EXPECT_EQ(HashMap(replica.map()), HashMap(map_));
}

TEST_F(SnapshotSenderTest, WhatAnAskerHasIsNotSentAgain) {
  MapReplica replica(map_.id());
  sender_.Add(replica.MakeRequest(kAsker));
  SendAll();
  Deliver(&replica, 50);  // the first are lost
  EXPECT_EQ(replica.map().revision(), 0u);
  keyframes_.written.clear();
  sender_.Add(replica.MakeRequest(kAsker));
  SendAll();
  EXPECT_EQ(keyframes_.written.size(), 50u);
  Deliver(&replica);
  EXPECT_EQ(HashMap(replica.map()), HashMap(map_));
}

TEST_F(SnapshotSenderTest, AnAskerThatRepeatsItselfStartsNothingAnew) {
  const MapReplica replica(map_.id());
  sender_.Add(replica.MakeRequest(kAsker));
  while (!sender_.IsIdle()) {
    sender_.SendPiece(0);
    if (!sender_.IsIdle()) sender_.Add(replica.MakeRequest(kAsker));
  }
  EXPECT_EQ(keyframes_.written.size(), map_.keyframes().size());
  EXPECT_EQ(sender_.sent(), 1u);
}

TEST_F(SnapshotSenderTest, AnAskerThatComesMeanwhileGetsAllItLacks) {
  MapReplica first(map_.id()), second(map_.id());
  sender_.Add(first.MakeRequest(kAsker));
  sender_.SendPiece(0);
  const size_t missed = keyframes_.written.size();
  sender_.Add(second.MakeRequest(kOther));
  SendAll();
  Deliver(&first);
  Deliver(&second, missed);
  EXPECT_EQ(HashMap(first.map()), HashMap(map_));
  EXPECT_EQ(HashMap(second.map()), HashMap(map_));
}

TEST_F(SnapshotSenderTest, AMapThatGrowsMeanwhileIsSentAsItIsAtTheEnd) {
  MapReplica replica(map_.id());
  sender_.Add(replica.MakeRequest(kAsker));
  sender_.SendPiece(0);
  for (int i = 0; i < 5; ++i) edits_.Edit(RandomEdits::kAddKeyFrame);
  static_cast<void>(map_.TakeDelta());
  SendAll();
  Deliver(&replica);
  EXPECT_EQ(HashMap(replica.map()), HashMap(map_));
}

TEST_F(SnapshotSenderTest, AMapThatGoesOrCantBeReadIsGivenUp) {
  sender_.Add(MapReplica(map_.id()).MakeRequest(kAsker));
  EXPECT_TRUE(sender_.SendPiece(0));
  is_here_ = false;
  EXPECT_FALSE(sender_.SendPiece(0));
  EXPECT_TRUE(sender_.IsIdle());
  EXPECT_TRUE(chunks_.written.empty());
  EXPECT_EQ(sender_.failed(), 0u);
  is_here_ = true;
  can_load_ = false;
  sender_.Add(MapReplica(map_.id()).MakeRequest(kAsker));
  EXPECT_FALSE(sender_.SendPiece(0));
  EXPECT_TRUE(sender_.IsIdle());
  EXPECT_EQ(sender_.failed(), 1u);
  EXPECT_EQ(sender_.sent(), 0u);
}

}  // namespace
}  // namespace portolan
