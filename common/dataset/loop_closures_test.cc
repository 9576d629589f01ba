#include "dataset/loop_closures.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "dataset/temp_folder.h"

namespace portolan {
namespace {

using testing::HasSubstr;

class LoopClosuresTest : public testing::Test {
 protected:
  Result<std::vector<LoopClosure>> Read(const std::string& text) {
    return ReadLoopClosures(folder_.Write("run.json", text));
  }
  std::string Complaint(const std::string& text) {
    const auto closures = Read(text);
    if (closures) return "no complaint";
    EXPECT_THAT(closures.error().message, HasSubstr(folder_.Path("run.json") + ": "));
    return closures.error().message;
  }
  TempFolder folder_;
};

TEST_F(LoopClosuresTest, ReadsStampsAndPassesOverTheRest) {
  const auto closures = Read(
      R"({"role": "loop_closer", "closures": [
            {"stamp_ns": 1403636579763555584, "matched_stamp_ns": -5, "inliers": 51, "scale": 1.01},
            {"matched_stamp_ns": 3, "stamp_ns": 4}]})");
  ASSERT_TRUE(closures) << closures.error().message;
  ASSERT_EQ(closures->size(), 2u);
  EXPECT_EQ((*closures)[0].stamp.ns, 1403636579763555584);
  EXPECT_EQ((*closures)[0].matched_stamp.ns, -5);
  EXPECT_EQ((*closures)[1].stamp.ns, 4);
  EXPECT_EQ((*closures)[1].matched_stamp.ns, 3);
}

TEST_F(LoopClosuresTest, LeavesOutWhatWasNotApplied) {
  const auto closures = Read(
      R"({"closures": [{"stamp_ns": 1, "matched_stamp_ns": 2, "applied": false},
                       {"stamp_ns": 3, "matched_stamp_ns": 4, "applied": true}]})");
  ASSERT_TRUE(closures) << closures.error().message;
  ASSERT_EQ(closures->size(), 1u);
  EXPECT_EQ((*closures)[0].stamp.ns, 3);
  EXPECT_THAT(Complaint(R"({"closures": [{"stamp_ns": 1, "matched_stamp_ns": 2, "applied": false}, {"stamp_ns": 1}]})"),
              HasSubstr("closures[1].matched_stamp_ns: missing"));
  EXPECT_THAT(Complaint(R"({"closures": [{"stamp_ns": 1, "matched_stamp_ns": 2, "applied": 1}]})"),
              HasSubstr("closures[0].applied: 1, expected true or false"));
}

TEST_F(LoopClosuresTest, ARunWithoutClosuresHasNone) {
  const auto closures = Read(R"({"closures": []})");
  ASSERT_TRUE(closures) << closures.error().message;
  EXPECT_TRUE(closures->empty());
}

TEST_F(LoopClosuresTest, NamesTheFileAndTheKeyOfWhatIsWrong) {
  EXPECT_THAT(Complaint("{}"), HasSubstr("closures: missing"));
  EXPECT_THAT(Complaint("[1, 2]"), HasSubstr("closures: missing"));
  EXPECT_THAT(Complaint(R"({"closures": 3})"), HasSubstr("closures: number, expected an array"));
  EXPECT_THAT(Complaint(R"({"closures": {"stamp_ns": 1}})"), HasSubstr("closures: object, expected an array"));
  EXPECT_THAT(Complaint(R"({"closures": [[]]})"), HasSubstr("closures[0]: array, expected an object"));
  EXPECT_THAT(Complaint(R"({"closures": [{"stamp_ns": 1, "matched_stamp_ns": 2}, {"stamp_ns": 1}]})"),
              HasSubstr("closures[1].matched_stamp_ns: missing"));
  for (const char* bad : {"1.5", "1e3", "\"7\"", "null", "true", "9223372036854775808", "[1]"}) {
    const std::string complaint =
        Complaint(std::string(R"({"closures": [{"matched_stamp_ns": 2, "stamp_ns": )") + bad + "}]}");
    EXPECT_THAT(complaint, HasSubstr("closures[0].stamp_ns: ")) << bad;
    EXPECT_THAT(complaint, HasSubstr("expected integer nanoseconds")) << bad;
  }
}

TEST_F(LoopClosuresTest, NamesTheFileAndThePlaceOfWhatIsNoJson) {
  EXPECT_THAT(Complaint("{\"closures\": [\n{\"stamp_ns\": 1,}]}"), HasSubstr("line 2"));
  EXPECT_THAT(Complaint(""), HasSubstr("line 1"));
  EXPECT_THAT(ReadLoopClosures("/no/such.json").error().message, HasSubstr("/no/such.json"));
}

}  // namespace
}  // namespace portolan
