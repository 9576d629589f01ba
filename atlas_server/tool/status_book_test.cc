#include "tool/status_book.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace portolan {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

ProcessStatus MakeStatus(const std::string& role, RobotId robot, uint32_t session, double frames, double waiting) {
  ProcessStatus status;
  status.process = ProcessId(robot, session, 1);
  status.role = role;
  status.host = "rack";
  status.pid = 4711;
  status.vendor = "cyclonedds";
  status.priority = "nice 4";
  status.state = "busy";
  status.map = MapId(0, 1, 1);
  status.revision = 9;
  status.figures = {{"frames", frames}, {"events_waiting", waiting}};
  return status;
}

TEST(StatusBookTest, TellsEachProcessTrackerFirstAndRobotByRobot) {
  StatusBook book;
  book.Hear(MakeStatus("atlas_server", 0, 1, 0, 0), 10);
  book.Hear(MakeStatus("frontend_tracker", 1, 2, 0, 0), 10);
  book.Hear(MakeStatus("frontend_tracker", 0, 3, 0, 7), 10);
  EXPECT_EQ(book.size(), 3u);
  const std::string text = book.Format(10.5);
  EXPECT_THAT(text, HasSubstr("rack"));
  EXPECT_THAT(text, HasSubstr("4711"));
  EXPECT_THAT(text, HasSubstr("cyclonedds"));
  EXPECT_THAT(text, HasSubstr("nice 4"));
  EXPECT_THAT(text, HasSubstr("busy"));
  EXPECT_THAT(text, HasSubstr("0.000001.1 at 9"));
  EXPECT_THAT(text, HasSubstr("7 events"));
  const size_t tracker = text.find("frontend_tracker"), atlas = text.find("atlas_server"),
               other = text.rfind("frontend_tracker");
  EXPECT_LT(tracker, atlas);
  EXPECT_LT(atlas, other);
}

TEST(StatusBookTest, RatesComeFromTheSecondStatusOnAsTheFirstMayBeOld) {
  StatusBook book;
  book.Hear(MakeStatus("frontend_tracker", 0, 1, 100, 0), 10.0);
  book.Hear(MakeStatus("frontend_tracker", 0, 1, 130, 0), 10.3);
  EXPECT_TRUE(book.ToJson(10.3)[0]["rates"].empty());
  book.Hear(MakeStatus("frontend_tracker", 0, 1, 160, 0), 11.3);
  EXPECT_THAT(book.Format(11.3), HasSubstr("30.0 frames/s"));
  EXPECT_NEAR(book.ToJson(11.3)[0]["rates"]["frames"].get<double>(), 30, 1e-9);
  book.Hear(MakeStatus("frontend_tracker", 0, 1, 160, 0), 12.3);
  EXPECT_THAT(book.Format(12.3), Not(HasSubstr("frames/s")));
}

TEST(StatusBookTest, BytesAreToldInKilobytesASecond) {
  StatusBook book;
  ProcessStatus status = MakeStatus("frontend_tracker", 0, 1, 0, 0);
  for (const double now_s : {10.0, 11.0, 12.0}) {
    status.figures = {{"bytes_sent", 250e3 * now_s}, {"bytes_received", 10 * now_s}};
    book.Hear(status, now_s);
  }
  EXPECT_THAT(book.Format(12.0), HasSubstr("250.0 kB/s sent"));
  EXPECT_THAT(book.Format(12.0), Not(HasSubstr("received"))) << "next to nothing";
}

TEST(StatusBookTest, StatusesInQuickSuccessionMakeNoWildRates) {
  StatusBook book;
  for (const double frames : {100.0, 110.0}) book.Hear(MakeStatus("frontend_tracker", 0, 1, frames, 0), frames / 10);
  book.Hear(MakeStatus("frontend_tracker", 0, 1, 111, 0), 11.001);
  EXPECT_TRUE(book.ToJson(11.001)[0]["rates"].empty());
}

TEST(StatusBookTest, SilenceIsTold) {
  StatusBook book;
  book.Hear(MakeStatus("backend_mapper", 0, 1, 0, 0), 10);
  EXPECT_THAT(book.Format(15), HasSubstr("silent for 5 s"));
  EXPECT_EQ(book.ToJson(15)[0]["silent_s"], 5.0);
}

TEST(StatusBookTest, JsonHasAllFigures) {
  StatusBook book;
  book.Hear(MakeStatus("backend_mapper", 3, 1, 12, 4), 10);
  const nlohmann::json entry = book.ToJson(10)[0];
  EXPECT_EQ(entry["role"], "backend_mapper");
  EXPECT_EQ(entry["robot"], 3);
  EXPECT_EQ(entry["figures"]["events_waiting"], 4.0);
  EXPECT_EQ(entry["map"], "0.000001.1");
}

TEST(StatusBookTest, KnowsWhetherARoleIsMissing) {
  StatusBook book;
  uint32_t session = 0;
  for (const char* role : {"atlas_server", "backend_mapper", "frontend_tracker", "frontend_tracker"}) {
    book.Hear(MakeStatus(role, 0, ++session, 0, 0), 10);
    EXPECT_FALSE(book.HasEveryRole()) << role;
  }
  book.Hear(MakeStatus("loop_closer", 0, ++session, 0, 0), 10);
  EXPECT_TRUE(book.HasEveryRole());
}

TEST(StatusBookTest, FindsTheProcessOfARoleThatWasHeardLast) {
  StatusBook book;
  EXPECT_EQ(book.Find("atlas_server"), nullptr);
  book.Hear(MakeStatus("atlas_server", 0, 1, 0, 0), 10);
  book.Hear(MakeStatus("atlas_server", 0, 2, 0, 0), 11);
  book.Hear(MakeStatus("backend_mapper", 0, 3, 0, 0), 12);
  ASSERT_NE(book.Find("atlas_server"), nullptr);
  EXPECT_EQ(book.Find("atlas_server")->process, ProcessId(0, 2, 1));
}

}  // namespace
}  // namespace portolan
