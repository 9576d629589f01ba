// portolan_lookup_time: how long the atlas_server takes to look a keyframe up in many dormant maps, made by the
// synthetic builder: streets with houses, whose keyframes lie in a store as those of dormant maps do.

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <filesystem>

#include "atlas/map_shelf.h"
#include "atlas/map_store.h"
#include "base/command_line.h"
#include "base/time.h"
#include "benchmark/street.h"
#include "testing/map_builder.h"

namespace portolan {
namespace {

struct Arguments {
  int maps = 20, keyframes = 200, queries = 60;
  double memory_mb = ShelfOptions().memory_mb, maps_mb = ShelfOptions().maps_mb;
  std::string folder = "/tmp";
};

constexpr const char* kToMeet = "; to meet: median at most 10 ms over 20 maps and 4000 keyframes";

class Benchmark {
 public:
  Benchmark(const Arguments& arguments, std::shared_ptr<const Vocabulary> vocabulary, MapStore* store)
      : arguments_(arguments),
        store_(*store),
        shelf_(
            Options(arguments), std::move(vocabulary), [this](KeyFrameId id) { return Load(id); },
            [this](MapId id) { return store_.LoadState(id); }) {}

  Status Run() {
    for (int number = 0; number < arguments_.maps; ++number) {
      const auto session = static_cast<uint32_t>(number + 1);
      if (Status added =
              Add(MakeStreet(number, arguments_.keyframes, arguments_.keyframes, session), MapId(0, 1, session), true);
          !added)
        return added;
    }
    fmt::print("{} maps, {} of them paged, {} keyframes indexed, {:.0f} MB of descriptors in memory\n", arguments_.maps,
               shelf_.num_paged(), shelf_.indexed_keyframes(), shelf_.appearance_mb());
    // A place that no map has, and one that is in the first map.
    Query("elsewhere", MakeStreet(1000, arguments_.keyframes, arguments_.queries, 1000), MapId(0, 1, 1000));
    Query("revisit", MakeStreet(0, arguments_.keyframes, arguments_.queries, 1001), MapId(0, 1, 1001));
    return Ok{};
  }

 private:
  static ShelfOptions Options(const Arguments& arguments) {
    ShelfOptions options;
    options.memory_mb = arguments.memory_mb;
    options.maps_mb = arguments.maps_mb;
    return options;
  }

  Result<KeyFrameData> Load(KeyFrameId id) {
    const Stopwatch stopwatch;
    Result<KeyFrameData> data = store_.LoadKeyFrame(id);
    times_.Add("read_keyframe", stopwatch.Milliseconds());
    return data;
  }

  Status Add(const SyntheticScene& scene, MapId id, bool stored) {
    MapBuilderOptions options;
    options.map = id;
    const Map map = BuildMap(scene, options);
    Map published = map;
    published.TakeDelta();
    shelf_.replicas().AddDelta(published.Snapshot());  // first: data that nothing waits for would not be kept
    std::vector<std::shared_ptr<const KeyFrameData>> data;
    for (const auto& [keyframe_id, keyframe] : map.keyframes()) {
      shelf_.AddKeyFrame(id, *keyframe.data);
      data.push_back(keyframe.data);
    }
    shelf_.ApplyPending();
    if (shelf_.FindMap(id) == nullptr) return Error{"the map is none: " + shelf_.maps().at(id).last_problem()};
    if (!stored) return Ok{};
    if (Status saved = store_.SaveKeyFrames(data); !saved) return saved;
    if (Status saved = store_.SaveMap(published.Snapshot()); !saved) return saved;
    for (const auto& keyframe : data) shelf_.OnStored(keyframe->id);
    Trim(MapId());
    return Ok{};
  }

  /// @param active is none of the stored ones.
  void Trim(MapId active) {
    shelf_.Trim([active](const Map& map) { return map.id() != active; });
  }

  void Query(const char* name, const SyntheticScene& scene, MapId id) {
    if (!Add(scene, id, false)) return;
    std::vector<MapId> order;
    for (int number = 0; number < arguments_.maps; ++number)
      order.emplace_back(0, 1, static_cast<uint32_t>(arguments_.maps - number));
    OverlapDetector detector{OverlapOptions()};
    times_ = StageTimes();
    int confirmed = 0, overlaps = 0, verified = 0;
    const uint64_t loads = shelf_.loads(), map_loads = shelf_.map_loads();
    const Map& map = *shelf_.FindMap(id);
    for (const auto& [keyframe, state] : map.keyframes()) {
      const Stopwatch stopwatch;
      shelf_.BeginLookUp();
      const OverlapDetection detection =
          detector.Detect(map, keyframe, *shelf_.FindWords(keyframe), shelf_.Others(order), shelf_.Ensurer(), &times_);
      times_.Add("lookup", stopwatch.Milliseconds());
      Trim(id);
      confirmed += detection.confirmed ? 1 : 0;
      overlaps += detection.overlap ? 1 : 0;
      verified += detection.verified;
    }
    fmt::print(
        "{}: {} keyframes, {} candidates verified, {} confirmed, {} overlaps; read from the store: {} maps, {} "
        "keyframes' descriptors\n",
        name, map.keyframes().size(), verified, confirmed, overlaps, shelf_.map_loads() - map_loads,
        shelf_.loads() - loads);
    for (const auto& [stage, samples] : times_.samples()) {
      fmt::print("  {:18} {:5} x median {:6.2f} p95 {:6.2f} max {:6.2f} ms{}\n", stage, samples.size(),
                 Quantile(samples, 0.5), Quantile(samples, 0.95), Quantile(samples, 1),
                 stage == "lookup" ? kToMeet : "");
    }
    shelf_.Remove(id);
  }

  const Arguments& arguments_;
  MapStore& store_;
  MapShelf shelf_;
  StageTimes times_;  // of one kind of query
};

Status Run(const Arguments& arguments) {
  const auto vocabulary = Vocabulary::Open(Vocabulary::DefaultPath());
  if (!vocabulary) return vocabulary.error();
  const std::string path = arguments.folder + "/lookup_time_" + std::to_string(DrawSession()) + ".db";
  Status done = Ok{};
  {
    auto store = MapStore::Open(path);
    if (!store) return store.error();
    done = Benchmark(arguments, *vocabulary, store->get()).Run();
  }
  for (const char* suffix : {"", "-wal", "-shm"}) std::filesystem::remove(path + suffix);
  return done;
}

}  // namespace
}  // namespace portolan

int main(int argc, char** argv) {
  CLI::App app("Time of a lookup over many dormant maps", "portolan_lookup_time");
  portolan::Arguments arguments;
  app.add_option("--maps", arguments.maps, "dormant maps")->capture_default_str();
  app.add_option("--keyframes", arguments.keyframes, "of each")->capture_default_str();
  app.add_option("--queries", arguments.queries, "keyframes looked up, of each kind")->capture_default_str();
  app.add_option("--memory-mb", arguments.memory_mb, "for descriptors (atlas.memory_mb)")->capture_default_str();
  app.add_option("--maps-mb", arguments.maps_mb, "for maps (atlas.maps_mb)")->capture_default_str();
  app.add_option("--folder", arguments.folder, "for the store, some 100 kB a keyframe; removed at the end")
      ->capture_default_str();
  if (const auto code = portolan::ParseCommandLine(&app, argc, argv)) return *code;
  const portolan::Status status = portolan::Run(arguments);
  if (!status) fmt::print(stderr, "portolan_lookup_time: {}\n", status.error().message);
  return status.ok() ? 0 : 1;
}
