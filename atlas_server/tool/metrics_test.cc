#include "tool/metrics.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <regex>
#include <set>
#include <sstream>

namespace portolan {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

ProcessStatus MakeStatus(const std::string& role, uint32_t session,
                         std::vector<std::pair<std::string, double>> figures) {
  ProcessStatus status;
  status.process = ProcessId(2, session, 1);
  status.role = role;
  status.host = "rack";
  status.pid = 4711;
  status.vendor = "cyclonedds";
  status.priority = "nice 4";
  status.revision = 9;
  status.figures = std::move(figures);
  return status;
}

std::vector<std::string> Lines(const std::string& text) {
  std::vector<std::string> lines;
  std::istringstream stream(text);
  for (std::string line; std::getline(stream, line);) lines.push_back(line);
  return lines;
}

/// The metric's name in a line; of HELP and TYPE too.
std::string NameIn(const std::string& line) {
  const size_t begin = line[0] == '#' ? 7 : 0;  // "# HELP ", "# TYPE "
  return line.substr(begin, line.find_first_of("{ ", begin) - begin);
}

TEST(MetricsTest, EachMetricHasHelpAndTypeOnceAndItsSamplesTogether) {
  StatusBook book;
  book.Hear(MakeStatus("frontend_tracker", 1, {{"frames", 100}, {"events_waiting", 3}, {"cpu_s", 1.5}}), 10);
  book.Hear(MakeStatus("backend_mapper", 2, {{"keyframes_taken", 7}, {"events_waiting", 0}}), 10);
  std::set<std::string> begun;
  std::string current;
  const std::regex sample("portolan_[a-z_]+\\{[a-z_]+=\"[^\"]*\"(,[a-z_]+=\"[^\"]*\")*\\} [0-9.e+-]+");
  for (const std::string& line : Lines(FormatMetrics(book, 10.5))) {
    if (line.rfind("# HELP ", 0) == 0) {
      current = NameIn(line);
      EXPECT_TRUE(begun.insert(current).second) << line;
    } else if (line.rfind("# TYPE ", 0) != 0) {
      EXPECT_TRUE(std::regex_match(line, sample)) << line;
    }
    EXPECT_EQ(NameIn(line), current);
  }
  EXPECT_THAT(begun, testing::IsSupersetOf({"portolan_frames_total", "portolan_events_waiting",
                                            "portolan_cpu_seconds_total", "portolan_process_up"}));
}

TEST(MetricsTest, CountersEndInTotalAndTheRestAreGauges) {
  StatusBook book;
  book.Hear(MakeStatus("frontend_tracker", 1, {{"frames", 100}, {"events_waiting", 3}}), 10);
  const std::string text = FormatMetrics(book, 10.5);
  EXPECT_THAT(text, HasSubstr("# TYPE portolan_frames_total counter\n"));
  EXPECT_THAT(text, HasSubstr("# TYPE portolan_events_waiting gauge\n"));
  EXPECT_THAT(text, HasSubstr("portolan_frames_total{role=\"frontend_tracker\",robot=\"2\",host=\"rack\",process=\"" +
                              ToString(ProcessId(2, 1, 1)) + "\"} 100\n"));
}

TEST(MetricsTest, ASilentProcessIsDownAndARoleThatNobodyHasIsThereWithNone) {
  StatusBook book;
  EXPECT_THAT(FormatMetrics(book, 10), HasSubstr("portolan_processes{role=\"backend_mapper\"} 0\n"));
  book.Hear(MakeStatus("backend_mapper", 1, {}), 10);
  EXPECT_THAT(FormatMetrics(book, 11), HasSubstr("portolan_processes{role=\"backend_mapper\"} 1\n"));
  const std::string text = FormatMetrics(book, 10 + StatusBook::kSilentS + 1);
  EXPECT_THAT(text, HasSubstr("portolan_processes{role=\"backend_mapper\"} 0\n"));
  EXPECT_TRUE(std::regex_search(text, std::regex("portolan_process_up\\{.*\\} 0\n")));
  EXPECT_TRUE(std::regex_search(text, std::regex("portolan_process_silent_seconds\\{.*\\} 4\n")));
}

TEST(MetricsTest, LabelsAreEscaped) {
  StatusBook book;
  ProcessStatus status = MakeStatus("frontend_tracker", 1, {});
  status.host = "a\"b\\c\nd";
  book.Hear(status, 10);
  EXPECT_THAT(FormatMetrics(book, 10), HasSubstr("host=\"a\\\"b\\\\c\\nd\""));
}

TEST(MetricsTest, AFigureWithoutANameOfItsOwnIsNotLost) {
  StatusBook book;
  book.Hear(MakeStatus("frontend_tracker", 1, {{"of_tomorrow", 0.25}}), 10);
  EXPECT_TRUE(
      std::regex_search(FormatMetrics(book, 10), std::regex("portolan_figure\\{.*figure=\"of_tomorrow\"\\} 0.25\n")));
}

TEST(MetricsTest, ProcessesThatAreLongGoneAreForgotten) {
  StatusBook book;
  book.Hear(MakeStatus("backend_mapper", 1, {}), 10);
  book.Hear(MakeStatus("backend_mapper", 2, {}), 10 + StatusBook::kForgottenS + 1);
  const std::string text = FormatMetrics(book, 10 + StatusBook::kForgottenS + 1);
  EXPECT_THAT(text, Not(HasSubstr(ToString(ProcessId(2, 1, 1)))));
  EXPECT_THAT(text, HasSubstr(ToString(ProcessId(2, 2, 1))));
}

}  // namespace
}  // namespace portolan
