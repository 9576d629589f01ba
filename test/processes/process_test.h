#pragma once

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "dataset/temp_folder.h"
#include "processes/child_process.h"
#include "processes/status_watch.h"

namespace portolan {

/// For failures alone: a passing test never waits it out, on a busy machine or under a sanitizer either.
constexpr std::chrono::seconds kProcessDeadline(180);

/// The value of --speed for a run in real time, slower under a sanitizer, with which a frame takes the tracker longer.
std::string RealTimeSpeed(double factor);

/// Exit code and output of a program that has ended.
struct Ended {
  int code = -1;                ///< -1: it did not end before the deadline
  std::string output;           ///< both standard output and standard error
  std::string standard_output;  ///< a DDS vendor's own lines (Cyclone DDS: a participant without keys) are not in it
};

std::string ReadWholeFile(const std::string& path);
/// A JSON object; a failed expectation and an empty one if it is none.
nlohmann::json ReadReport(const std::string& path);

/// A test that starts programs: each in a DDS domain and a folder of its own.
class ProcessTest : public ::testing::Test {
 protected:
  ProcessTest();

  /// An installed program; its folder is that of the installation, or $PORTOLAN_BIN.
  static std::string Program(const std::string& name);
  /// A data set that CTest's fixture rendered.
  static std::string Sequence(const std::string& name = "street");
  static uint64_t NumFrames();
  std::string Out() const { return folder_.Path("out"); }
  std::string Truth() const { return Sequence() + "/groundtruth.txt"; }

  /// run.sh into Out() in this test's domain, with these arguments besides.
  std::vector<std::string> RunCommand(const std::vector<std::string>& arguments) const;
  std::unique_ptr<ChildProcess> Start(const std::vector<std::string>& command);
  Ended WaitForEnd(ChildProcess* process) const;
  Ended RunToEnd(const std::vector<std::string>& command);

  /// OUT/<role>.json or OUT/summary.json.
  nlohmann::json Report(const std::string& name) const { return ReadReport(Out() + "/" + name + ".json"); }
  /// A copy of the rendered data set, to be spoiled. @return its folder.
  std::string CopyOfSequence() const;
  /// The street in pieces (see make_sequence.py). @return its folder.
  std::string InPieces(const std::string& parts);
  /// The first piece of the street, there and back again and again: all is seen after one round, so that in lockstep no
  /// frame is lost however busy the machine is. @return its folder.
  std::string InRounds(int rounds);
  static constexpr uint64_t kRound = 120;  ///< frames
  /// Everything that the programs wrote, for the message of a failure.
  std::string Logs() const;

  TempFolder folder_;
  int domain_;

 private:
  int num_started_ = 0;
};

}  // namespace portolan
