#include "tracking/keyframe_resend.h"

#include <gmock/gmock.h>

namespace portolan {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;
using ::testing::SizeIs;

const KeyFrameId kFirst(0, 3, 1), kSecond(0, 3, 2);
const std::vector<KeyFrameId> kBoth = {kFirst, kSecond};

std::vector<KeyFrameId> MakeIds(uint32_t count) {
  std::vector<KeyFrameId> ids;
  for (uint32_t i = 1; i <= count; ++i) ids.emplace_back(0, 3, i);
  return ids;
}

class KeyFrameResendTest : public ::testing::Test {
 protected:
  void SendBoth() {
    for (const KeyFrameId id : kBoth) resend_.OnSent(id, 0);
  }
  KeyFrameResend resend_;
};

TEST_F(KeyFrameResendTest, WhatIsDeliveredAndUnansweredGoesAgainEachTimeLater) {
  SendBoth();
  std::vector<double> times;
  for (double now_s = 0; now_s < 50; now_s += 0.5) {
    const auto due = resend_.Take(kBoth, kSecond, true, now_s);
    if (!due.empty() && due.back() == kSecond) times.push_back(now_s);
  }
  EXPECT_THAT(times, ElementsAre(2, 6, 14, 30, 46));
}

TEST_F(KeyFrameResendTest, OneThatNobodyWaitsForIsGivenUp) {
  SendBoth();
  int times = 0;
  for (double now_s = 0; now_s < 500; now_s += 0.5) {
    for (const KeyFrameId id : resend_.Take(kBoth, kSecond, true, now_s)) times += id == kFirst ? 1 : 0;
  }
  EXPECT_EQ(times, KeyFrameResend::kMaxTimes);
}

TEST_F(KeyFrameResendTest, WhatIsOnItsWayIsLeftToDds) {
  SendBoth();
  for (double now_s = 0; now_s < 60; now_s += 0.5)
    EXPECT_THAT(resend_.Take(kBoth, kSecond, false, now_s), IsEmpty()) << "a cut link, " << now_s;
  EXPECT_THAT(resend_.Take(kBoth, kSecond, true, 60), ElementsAre(kFirst, kSecond));
}

TEST_F(KeyFrameResendTest, ADeadReaderDoesNotKeepTheMapperFromItsKeyFrames) {
  SendBoth();
  std::vector<double> times;
  for (double now_s = 0; now_s < 25; now_s += 0.5) {
    resend_.OnMapperHeard(now_s);
    if (!resend_.Take(kBoth, kSecond, false, now_s).empty()) times.push_back(now_s);
  }
  EXPECT_THAT(times, ElementsAre(10, 20));
}

TEST_F(KeyFrameResendTest, ANewMapperGetsAllAtOnce) {
  SendBoth();
  resend_.OnNewMapper();
  EXPECT_THAT(resend_.Take(kBoth, kSecond, false, 0.1), ElementsAre(kFirst, kSecond));
  EXPECT_THAT(resend_.Take(kBoth, kSecond, false, 0.2), IsEmpty());
}

TEST_F(KeyFrameResendTest, ManyGoInBatches) {
  const auto ids = MakeIds(2 * KeyFrameResend::kBatch + 1);
  resend_.OnNewMapper();
  std::vector<KeyFrameId> sent;
  for (const size_t size : {KeyFrameResend::kBatch, KeyFrameResend::kBatch, size_t{1}, size_t{0}}) {
    const auto due = resend_.Take(ids, ids.back(), true, 1);
    EXPECT_THAT(due, SizeIs(size));
    sent.insert(sent.end(), due.begin(), due.end());
  }
  EXPECT_EQ(sent, ids);
}

TEST_F(KeyFrameResendTest, WhatIsAcknowledgedIsForgotten) {
  SendBoth();
  EXPECT_THAT(resend_.Take({kSecond}, std::nullopt, true, 2), ElementsAre(kSecond));
  EXPECT_THAT(resend_.Take({}, std::nullopt, true, 20), IsEmpty());
}

}  // namespace
}  // namespace portolan
