#include <gtest/gtest.h>
#include <poll.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <filesystem>
#include <map>

#include "atlas/map_store.h"
#include "base/random.h"
#include "map/random_edits.h"

// kill -9 in the middle of writing: a child process writes maps as fast as it can and tells through a pipe what it is
// about to do and what was acknowledged; it is killed at a random moment, fifty times on the same file.

namespace portolan {
namespace {

constexpr int kKills = 50;
constexpr uint64_t kSeed = 20261126;

enum class Event : uint64_t { kWriting, kWritten, kDeleting, kDeleted };

/// What goes through the pipe: smaller than PIPE_BUF, so whole or not at all.
struct Note {
  Event event;
  MapId map;
  Revision revision = 0;
  uint64_t hash = 0;
};

/// The child. Never returns: it writes until it is killed.
[[noreturn]] void WriteMapsForEver(const std::string& path, uint32_t session, uint64_t seed, int pipe) {
  const auto tell = [pipe](const Note& note) {
    if (write(pipe, &note, sizeof note) != sizeof note) _exit(3);
  };
  auto store = MapStore::Open(path);
  if (!store.ok() || !(*store)->Load().ok()) _exit(4);
  Random random(seed);
  for (uint32_t number = 1;; ++number) {
    Map map(MapId(0, session, number), 1);
    RandomEdits edits(random.Below(1u << 30), &map);
    for (uint64_t states = 1 + random.Below(8); states > 0; --states) {
      for (int i = 0; i < 20; ++i) edits.Next();
      const MapDelta change = map.TakeDelta();
      std::vector<std::shared_ptr<const KeyFrameData>> data;
      for (const auto& [id, keyframe] : map.keyframes()) data.push_back(keyframe.data);
      tell({Event::kWriting, map.id(), map.revision(), HashMap(map)});
      MapStore::Graph graph;
      graph.activities = {{map.id(), MapId(0, session, 0xffffff), map.revision()}};
      const auto save = [&] {
        const bool append = (*store)->CanAppend(change) && random.Below(4) > 0;
        return append ? (*store)->SaveChanges({change}) : (*store)->SaveMap(map.Snapshot());
      };
      if (!(*store)->SaveKeyFrames(data).ok() || !save().ok() || !(*store)->SaveGraph(graph).ok()) _exit(5);
      tell({Event::kWritten, map.id(), map.revision(), HashMap(map)});
    }
    if (random.Below(4) > 0) continue;
    tell({Event::kDeleting, map.id()});
    if (!(*store)->DeleteMap(map.id()).ok()) _exit(6);
    tell({Event::kDeleted, map.id()});
  }
}

/// What the file must hold, as far as the notes tell.
class Expectation {
 public:
  void Hear(const Note& note) {
    Known& known = maps_[note.map];
    switch (note.event) {
      case Event::kWriting:
        known.hashes[note.revision] = note.hash;
        break;
      case Event::kWritten:
        known.acknowledged = note.revision;
        break;
      case Event::kDeleting:
        known.may_be_gone = true;
        break;
      case Event::kDeleted:
        known.is_gone = true;
    }
    ++notes_;
  }

  void Compare(const MapStore::Content& content) {
    EXPECT_TRUE(content.problems.empty()) << content.problems.front();
    std::map<MapId, const StoredMap*> stored;
    for (const StoredMap& map : content.maps) stored[map.snapshot.map] = &map;
    for (const auto& [id, map] : stored) ASSERT_EQ(maps_.count(id), 1u) << "map " << id << " was never written";
    for (auto& [id, known] : maps_) {
      if (stored.count(id) == 1) {
        CompareMap(*stored.at(id), &known);
      } else {
        EXPECT_TRUE(known.acknowledged == 0 || known.may_be_gone)
            << "map " << id << " was acknowledged and is not there";
        known.is_gone = true;
      }
    }
  }
  size_t notes() const { return notes_; }

 private:
  struct Known {
    std::map<Revision, uint64_t> hashes;
    Revision acknowledged = 0;
    bool may_be_gone = false, is_gone = false;
  };

  /// What was acknowledged, or the one state that was being written when it ended.
  static void CompareMap(const StoredMap& stored, Known* known) {
    const MapId id = stored.snapshot.map;
    EXPECT_FALSE(known->is_gone) << "map " << id << " was deleted, or missing before";
    const Result<Map> map = RestoreMap(stored, nullptr);
    ASSERT_TRUE(map.ok()) << map.error().message;
    EXPECT_GE(map->revision(), known->acknowledged) << "map " << id;
    ASSERT_EQ(known->hashes.count(map->revision()), 1u) << "map " << id << " at revision " << map->revision();
    EXPECT_EQ(HashMap(*map), known->hashes.at(map->revision())) << "map " << id;
    known->acknowledged = map->revision();
    known->may_be_gone = false;
  }

  std::map<MapId, Known> maps_;
  size_t notes_ = 0;
};

/// Reads notes until the deadline, or the end of the pipe. @return whether it goes on.
bool ReadNotes(int pipe, std::chrono::steady_clock::time_point deadline, Expectation* expectation) {
  for (;;) {
    const auto left =
        std::chrono::duration_cast<std::chrono::microseconds>(deadline - std::chrono::steady_clock::now()).count();
    if (left <= 0) return true;
    const timespec timeout{left / 1000000, left % 1000000 * 1000};
    pollfd ready{pipe, POLLIN, 0};
    if (ppoll(&ready, 1, &timeout, nullptr) == 0) return true;
    Note note;
    if (read(pipe, &note, sizeof note) != sizeof note) return false;
    expectation->Hear(note);
  }
}

TEST(MapStoreKillTest, WhatWasAcknowledgedIsThereAfterFiftyKills) {
  std::string folder = std::filesystem::temp_directory_path() / "portolan_kill_XXXXXX";
  ASSERT_NE(mkdtemp(folder.data()), nullptr);
  const std::string path = folder + "/atlas.db";
  Random random(kSeed);
  Expectation expectation;
  for (int round = 1; round <= kKills; ++round) {
    const uint64_t seed = random.Below(1u << 30), delay_us = random.Below(120'000);
    SCOPED_TRACE("round " + std::to_string(round) + ", seed " + std::to_string(seed) + ", killed after " +
                 std::to_string(delay_us) + " us");
    int ends[2];
    ASSERT_EQ(pipe(ends), 0);
    const pid_t child = fork();
    ASSERT_GE(child, 0);
    if (child == 0) {
      close(ends[0]);
      WriteMapsForEver(path, static_cast<uint32_t>(round), seed, ends[1]);
    }
    close(ends[1]);
    // The moment counts from the first note: before that the file is only being opened, which every fifth round ends
    // too.
    const auto now = std::chrono::steady_clock::now();
    const bool while_opening = round % 5 == 0;
    if (while_opening || ReadNotes(ends[0], now, &expectation)) {
      Note first;
      if (!while_opening && read(ends[0], &first, sizeof first) == sizeof first) expectation.Hear(first);
      const auto moment =
          std::chrono::steady_clock::now() + std::chrono::microseconds(while_opening ? delay_us / 10 : delay_us);
      EXPECT_TRUE(ReadNotes(ends[0], moment, &expectation)) << "the writer ended by itself";
    }
    ASSERT_EQ(kill(child, SIGKILL), 0);
    while (ReadNotes(ends[0], std::chrono::steady_clock::time_point::max(), &expectation)) {
    }
    close(ends[0]);
    int status = 0;
    ASSERT_EQ(waitpid(child, &status, 0), child);
    ASSERT_TRUE(WIFSIGNALED(status) && WTERMSIG(status) == SIGKILL) << "exit code " << WEXITSTATUS(status);

    auto store = MapStore::Open(path);
    ASSERT_TRUE(store.ok()) << store.error().message;
    const auto content = (*store)->Load();
    ASSERT_TRUE(content.ok()) << content.error().message;
    expectation.Compare(*content);
    if (HasFatalFailure()) break;
  }
  RecordProperty("notes", static_cast<int>(expectation.notes()));
  EXPECT_GT(expectation.notes(), 2u * kKills) << "the writers did next to nothing";
  std::filesystem::remove_all(folder);
}

}  // namespace
}  // namespace portolan
