// portolan_open_time: how long the atlas_server takes from its start to a frame that is located in an atlas of many
// keyframes. The file is made by the synthetic builder, in a process of its own, and dropped from the cache of the
// system before it is opened.

#include <fcntl.h>
#include <fmt/format.h>
#include <malloc.h>
#include <sys/wait.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <cstdlib>
#include <filesystem>
#include <fstream>

#include "atlas/map_shelf.h"
#include "atlas/map_store.h"
#include "atlas/place_locator.h"
#include "base/command_line.h"
#include "base/time.h"
#include "benchmark/street.h"
#include "testing/map_builder.h"

namespace portolan {
namespace {

constexpr double kToMeetMs = 3000;  // for 1000 keyframes

struct Arguments {
  int maps = 1, keyframes = 1000, frames = 20;
  std::string folder = "/tmp";
};

MapId IdOf(int number) {
  return MapId(0, 1, static_cast<uint32_t>(number + 1));
}

Status MakeFile(const Arguments& arguments, const std::string& path) {
  auto store = MapStore::Open(path);
  if (!store) return store.error();
  for (int number = 0; number < arguments.maps; ++number) {
    const SyntheticScene scene =
        MakeStreet(number, arguments.keyframes, arguments.keyframes, static_cast<uint32_t>(number + 1));
    MapBuilderOptions options;
    options.map = IdOf(number);
    Map map = BuildMap(scene, options);
    map.TakeDelta();
    std::vector<std::shared_ptr<const KeyFrameData>> data;
    for (const auto& [id, keyframe] : map.keyframes()) data.push_back(keyframe.data);
    if (Status saved = (*store)->SaveKeyFrames(data); !saved) return saved;
    if (Status saved = (*store)->SaveMap(map.Snapshot()); !saved) return saved;
  }
  return Ok{};
}

/// In another process, so that this one's memory is as a start finds it.
Status MakeFileElsewhere(const Arguments& arguments, const std::string& path) {
  const pid_t child = fork();
  if (child < 0) return Error{"no process for making the file"};
  if (child == 0) {
    const Status made = MakeFile(arguments, path);
    if (!made) fmt::print(stderr, "{}\n", made.error().message);
    std::_Exit(made.ok() ? EXIT_SUCCESS : EXIT_FAILURE);
  }
  int status = 0;
  if (waitpid(child, &status, 0) != child || !WIFEXITED(status) || WEXITSTATUS(status) != EXIT_SUCCESS)
    return Error{"the file could not be made"};
  return Ok{};
}

/// As after a start of the machine.
Status DropFromCache(const std::string& path) {
  const int file = open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (file < 0) return Error{"'" + path + "' can't be opened"};
  const bool is_dropped = fdatasync(file) == 0 && posix_fadvise(file, 0, 0, POSIX_FADV_DONTNEED) == 0;
  close(file);
  return is_dropped ? Status(Ok{}) : Status(Error{"'" + path + "' stays in the system's cache"});
}

double ResidentMb() {
  size_t pages = 0, resident_pages = 0;
  std::ifstream("/proc/self/statm") >> pages >> resident_pages;
  return 1e-6 * static_cast<double>(resident_pages) * static_cast<double>(sysconf(_SC_PAGESIZE));
}

/// What the atlas_server does at its start, step by step.
class Start {
 public:
  explicit Start(std::string path) : path_(std::move(path)) {}

  Status Open() {
    auto vocabulary = Vocabulary::Open(Vocabulary::DefaultPath());
    if (!vocabulary) return vocabulary.error();
    Note("vocabulary opened");
    auto store = MapStore::Open(path_);
    if (!store) return store.error();
    store_ = std::move(*store);
    Note("file opened");
    shelf_ = std::make_unique<MapShelf>(ShelfOptions(), std::move(*vocabulary),
                                        [this](KeyFrameId id) { return store_->LoadKeyFrame(id); });
    std::vector<std::string> problems;
    const Status loaded = store_->LoadEachMap([this](StoredMap map) { TakeIn(std::move(map)); }, &problems);
    if (!loaded) return loaded.error();
    if (!problems.empty()) return Error{problems.front()};
    malloc_trim(0);
    Note("heap trimmed");
    return shelf_->Others(order_).size() == order_.size() ? Status(Ok{}) : Status(Error{"a map of the file is none"});
  }

  Result<LocatedFrame> Locate(const KeyFrameData& frame) {
    BowVector bow;
    const auto complete = shelf_->Complete(frame, &bow);
    shelf_->BeginEvent();
    Result<LocatedFrame> located =
        LocateFrame(*complete, bow, shelf_->Others(order_), shelf_->Ensurer(), LocatorOptions(), &times_);
    shelf_->Trim();
    return located;
  }

  /// The end of a step.
  void Note(const char* step) {
    fmt::print("  {:24} {:8.1f} ms {:6.0f} MB\n", step, step_.Milliseconds(), ResidentMb());
    step_.Restart();
  }
  double Milliseconds() const { return since_start_.Milliseconds(); }
  size_t keyframes() const { return shelf_->indexed_keyframes(); }

 private:
  void TakeIn(StoredMap map) {
    order_.push_back(map.snapshot.map);
    Note("read and decoded");
    shelf_->TakeIn(std::move(map), true, nullptr);
    Note("words found");
    shelf_->ApplyPending();
    Note("map made");
    shelf_->Trim();
    Note("trimmed");
  }

  std::string path_;
  Stopwatch since_start_, step_;
  std::unique_ptr<MapStore> store_;
  std::unique_ptr<MapShelf> shelf_;
  std::vector<MapId> order_;
  StageTimes times_;
};

Status Measure(const Arguments& arguments, const std::string& path) {
  const SyntheticScene frames = MakeStreet(0, arguments.keyframes, arguments.frames, 1001);
  if (Status dropped = DropFromCache(path); !dropped) return dropped;
  Start start(path);
  if (Status opened = start.Open(); !opened) return opened;
  int located = 0;
  std::vector<double> times;
  for (const SyntheticView& view : frames.views) {
    const Stopwatch stopwatch;
    const bool is_first = times.empty();
    located += start.Locate(*view.data) ? 1 : 0;
    times.push_back(stopwatch.Milliseconds());
    if (!is_first) continue;
    start.Note("first frame looked for");
    fmt::print("{} keyframes: {} after {:.0f} ms, at most {:.0f} for 1000\n", start.keyframes(),
               located == 1 ? "located" : "not located", start.Milliseconds(), kToMeetMs);
  }
  fmt::print("{} of {} frames located, a frame median {:.1f} max {:.1f} ms\n", located, times.size(),
             Quantile(times, 0.5), Quantile(times, 1));
  return Ok{};
}

Status Run(const Arguments& arguments) {
  const std::string path = arguments.folder + "/open_time_" + std::to_string(DrawSession()) + ".db";
  Status done = MakeFileElsewhere(arguments, path);
  if (done) done = Measure(arguments, path);
  for (const char* suffix : {"", "-wal", "-shm"}) std::filesystem::remove(path + suffix);
  return done;
}

}  // namespace
}  // namespace portolan

int main(int argc, char** argv) {
  CLI::App app("Time from the start to a frame located in an atlas of many keyframes", "portolan_open_time");
  portolan::Arguments arguments;
  app.add_option("--maps", arguments.maps, "of the atlas")->check(CLI::Range(1, 1000))->capture_default_str();
  app.add_option("--keyframes", arguments.keyframes, "of each")->check(CLI::Range(20, 100000))->capture_default_str();
  app.add_option("--frames", arguments.frames, "looked for")->check(CLI::Range(1, 100000))->capture_default_str();
  app.add_option("--folder", arguments.folder, "for the file, some 100 kB a keyframe; removed at the end")
      ->capture_default_str();
  if (const auto code = portolan::ParseCommandLine(&app, argc, argv)) return *code;
  const portolan::Status status = portolan::Run(arguments);
  if (!status) fmt::print(stderr, "portolan_open_time: {}\n", status.error().message);
  return status.ok() ? 0 : 1;
}
