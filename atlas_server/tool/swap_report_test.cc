#include "tool/swap_report.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "atlas/succession.h"

namespace portolan {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;

const MapId kMap(3, 10, 1);
const HeldMap kBefore{kMap, 1, 88, 34, 2045, 0xabc}, kAfter{kMap, 2, 88, 34, 2045, 0xabc};

SwapReport ReportOf(const std::string& role, const HeldMap& before, const HeldMap& after) {
  const Result<SwapReport> report = ParseSwapReport(
      DescribeSwap(role, 3, ProcessId(3, 20, 1), ProcessId(3, 30, 1), 0.4, {{kMap, before}}, {{kMap, after}}));
  EXPECT_TRUE(report.ok()) << report.error().message;
  return report.ok() ? *report : SwapReport();
}

TEST(SwapReport, TellsWhatTheAtlasServerAnswered) {
  const SwapReport report = ReportOf("backend_mapper", kBefore, kAfter);
  EXPECT_EQ(report.robot, 3);
  EXPECT_EQ(report.from, ProcessId(3, 20, 1));
  EXPECT_EQ(report.to, ProcessId(3, 30, 1));
  ASSERT_EQ(report.maps.size(), 1u);
  EXPECT_EQ(report.maps[0].after.epoch, 2u);
  EXPECT_THAT(report.Problem(), IsEmpty());
  EXPECT_THAT(
      FormatSwapReport(report),
      HasSubstr("the same\n  before: 34 keyframes, 2045 points, hash 0000000000000abc at revision 88 in epoch 1"));
}

TEST(SwapReport, AMapThatChangedOnItsWayIsAProblem) {
  HeldMap other = kAfter;
  other.keyframes = 33;
  EXPECT_THAT(ReportOf("backend_mapper", kBefore, other).Problem(), HasSubstr("33 keyframes"));
  other = kAfter;
  other.hash = 1;
  EXPECT_THAT(FormatSwapReport(ReportOf("backend_mapper", kBefore, other)), HasSubstr("NOT THE SAME"));
}

TEST(SwapReport, WhoFollowsMayHaveComeFurther) {
  const HeldMap later{kMap, 1, 90, 35, 2100, 0xdef};
  const SwapReport report = ReportOf("loop_closer", kBefore, later);
  EXPECT_THAT(report.Problem(), IsEmpty());
  EXPECT_THAT(FormatSwapReport(report), HasSubstr("gone on since"));
  EXPECT_THAT(ReportOf("loop_closer", kBefore, {kMap, 1, 88, 34, 2045, 0xdef}).Problem(), HasSubstr("not the same"));
}

TEST(SwapReport, RefusesAnotherText) {
  for (const char* text :
       {"", "ok", "{}", R"({"role":"loop_closer","robot":0,"from":"x","to":"y","seconds":1,"maps":[]})"}) {
    EXPECT_FALSE(ParseSwapReport(text).ok()) << text;
  }
}

}  // namespace
}  // namespace portolan
