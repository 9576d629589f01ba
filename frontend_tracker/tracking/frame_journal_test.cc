#include "tracking/frame_journal.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "dataset/temp_folder.h"
#include "testing/matchers.h"

namespace portolan {
namespace {

using ::testing::HasSubstr;

FrameRecord MakeRecord(uint64_t frame) {
  FrameRecord record;
  record.frame = frame;
  record.stamp = Timestamp{static_cast<int64_t>(1'500'000'000'123'456'789 + frame)};
  record.map = MapId(1, 0xfffffe, 3);
  record.anchor = KeyFrameId(1, 0xfffffe, 12);
  record.camera_from_anchor = Rigid3d(ExpSO3({0.1, -1.0 / 3, 1e-9}), {1.0 / 3, -2e-7, 3e5});
  record.online_camera_from_map = Rigid3d(ExpSO3({0, 0, 3}), {0, 1, 2});
  return record;
}

void ExpectSame(const FrameRecord& a, const FrameRecord& b) {
  EXPECT_EQ(a.frame, b.frame);
  EXPECT_EQ(a.stamp, b.stamp);
  EXPECT_EQ(a.map, b.map);
  EXPECT_EQ(a.anchor, b.anchor);
  EXPECT_EQ(a.online, b.online);
  const PoseTolerance exact{1e-15, 0};
  EXPECT_THAT(a.camera_from_anchor, RigidNear(b.camera_from_anchor, exact));
  EXPECT_THAT(a.online_camera_from_map, RigidNear(b.online_camera_from_map, exact));
}

class FrameJournalTest : public ::testing::Test {
 protected:
  FrameJournal Begin() const { return FrameJournal::Begin(path_, "/data/hall 3").value(); }
  EarlierRun Read() const { return FrameJournal::Read(path_).value().value(); }
  std::string ReadFailure() const {
    const auto read = FrameJournal::Read(path_);
    return read ? "" : read.error().message;
  }
  void AddText(const std::string& text) const { std::ofstream(path_, std::ios::app) << text; }

  TempFolder folder_;
  const std::string path_ = folder_.Path("journal.txt");
};

TEST_F(FrameJournalTest, WhatIsWrittenIsReadWithTheJournalStillOpen) {
  FrameRecord found_later = MakeRecord(4);
  found_later.online = false;
  FrameJournal journal = Begin();
  ASSERT_TRUE(journal.NoteStart({Timestamp{-5}, Timestamp{1'700'000'000'000'000'001}}));
  ASSERT_TRUE(journal.Append({MakeRecord(7), found_later}));
  const EarlierRun run = Read();
  EXPECT_EQ(run.data, "/data/hall 3");
  ASSERT_TRUE(run.start);
  EXPECT_EQ(run.start->first_stamp.ns, -5);
  EXPECT_EQ(run.start->unix_time.ns, 1'700'000'000'000'000'001);
  ASSERT_EQ(run.frames.size(), 2u);
  ExpectSame(run.frames[0], found_later);
  ExpectSame(run.frames[1], MakeRecord(7));
}

TEST_F(FrameJournalTest, TheLastLineOfAFrameCounts) {
  FrameRecord hung_elsewhere = MakeRecord(7);
  hung_elsewhere.anchor = KeyFrameId(1, 2, 3);
  FrameJournal journal = Begin();
  ASSERT_TRUE(journal.Append({MakeRecord(7), MakeRecord(8)}));
  ASSERT_TRUE(journal.Append({hung_elsewhere}));
  const EarlierRun run = Read();
  ASSERT_EQ(run.frames.size(), 2u);
  ExpectSame(run.frames[0], hung_elsewhere);
  EXPECT_FALSE(run.start);
}

TEST_F(FrameJournalTest, GoesOnBehindALineThatWasCutOff) {
  ASSERT_TRUE(Begin().Append({MakeRecord(7)}));
  AddText("frame 8 1500");
  EXPECT_EQ(Read().frames.size(), 1u);
  FrameJournal second = FrameJournal::GoOn(path_).value();
  ASSERT_TRUE(second.Append({MakeRecord(9)}));
  const EarlierRun run = Read();
  ASSERT_EQ(run.frames.size(), 2u);
  ExpectSame(run.frames[1], MakeRecord(9));
}

TEST_F(FrameJournalTest, ANewOneReplacesWhatWasThere) {
  ASSERT_TRUE(Begin().Append({MakeRecord(7)}));
  FrameJournal second = Begin();
  EXPECT_TRUE(Read().frames.empty());
  second.Remove();
  EXPECT_FALSE(std::filesystem::exists(path_));
  EXPECT_FALSE(FrameJournal::Read(path_).value().has_value());
  EXPECT_TRUE(second.Append({MakeRecord(8)})) << "a journal that is closed writes nothing";
}

TEST_F(FrameJournalTest, DamageIsNamedWithItsLine) {
  static_cast<void>(Begin());
  for (const char* line :
       {"", "frame", "frame 1 2 3 4 1 0 0 0 0 0 0 1 0 0 0 0 0 0", "frame 1 2 3 4 1 0 0 0 0 0 0 2 0 0 0 0 0 0 1",
        "frame 1 2 3 4 1 0 0 nan 0 0 0 1 0 0 0 0 0 0 1", "frame 1 2 3 4 1 0 0 0 0 0 0 1 0 0 0 0 0 0 1 5", "start 1",
        "end 1"}) {
    FrameJournal journal = Begin();
    AddText(std::string(line) + "\n");
    EXPECT_THAT(ReadFailure(), HasSubstr(path_ + ":3: ")) << line;
  }
  folder_.Write("journal.txt", "1.0 0 0 0 0 0 0 1\n");
  EXPECT_THAT(ReadFailure(), HasSubstr(path_ + ":1: expected portolan-frames 1"));
}

TEST_F(FrameJournalTest, AFolderThatIsNotThereIsNamed) {
  const auto journal = FrameJournal::Begin(folder_.Path("none/journal.txt"), "x");
  ASSERT_FALSE(journal);
  EXPECT_THAT(journal.error().message, HasSubstr("none/journal.txt: No such file or directory"));
}

TEST(FrameJournalWithoutFileTest, WritesNothing) {
  FrameJournal journal;
  EXPECT_TRUE(journal.Append({MakeRecord(1)}));
  EXPECT_TRUE(journal.NoteStart({}));
  journal.Remove();
}

}  // namespace
}  // namespace portolan
