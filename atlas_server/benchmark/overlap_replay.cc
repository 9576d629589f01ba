// portolan_overlap_replay: looks the keyframes of one finished map (of an atlas.db, portolan_pipeline_run --save-maps
// or portolan export) up in the others, in their order, as the atlas_server does. Prints what is found, refused and
// why, and the times.

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <filesystem>

#include "atlas/map_joiner.h"
#include "atlas/map_store.h"
#include "atlas/overlap_detector.h"
#include "base/command_line.h"
#include "base/time.h"
#include "map/map_file.h"
#include "map_optimization/map_fusion.h"

namespace portolan {
namespace {

struct Arguments {
  std::vector<std::string> files;
  size_t query = 0;  ///< index of the map, from 1; 0: the last
  bool fuse = false, verbose = false;
  OverlapOptions options;
};

Result<std::vector<StoredMap>> ReadAtlas(const std::string& file) {
  auto store = MapStore::Open(file);
  if (!store) return store.error();
  auto content = (*store)->Load();
  if (!content) return content.error();
  return std::move(content->maps);
}

bool IsAtlas(const std::string& file) {
  return std::filesystem::path(file).extension() == ".db";
}

Result<std::vector<Map>> ReadMaps(const std::vector<std::string>& files, const Vocabulary& vocabulary) {
  std::vector<Map> maps;
  for (const std::string& file : files) {
    const auto stored = IsAtlas(file) ? ReadAtlas(file) : ReadMapFile(file);
    if (!stored) return stored.error();
    for (const StoredMap& map : *stored) {
      Result<Map> restored = RestoreMap(map, &vocabulary);
      if (!restored) return restored.error();
      if (!restored->keyframes().empty()) maps.push_back(std::move(*restored));
    }
  }
  const auto first_stamp = [](const Map& map) { return map.keyframes().begin()->second.data->stamp; };
  std::sort(maps.begin(), maps.end(), [&](const Map& a, const Map& b) { return first_stamp(a) < first_stamp(b); });
  return maps;
}

void TryFusion(const Map& map, const Map& other, const DetectedOverlap& overlap) {
  StageTimes times;
  const Stopwatch stopwatch;
  const auto proposal =
      ProposeFusion(map, other, ToLoopClosure(overlap, map, other), LoopCorrectionOptions(), nullptr, &times);
  if (!proposal) {
    fmt::print("  fusion: {} ({:.0f} ms)\n", proposal.error().message, stopwatch.Milliseconds());
    return;
  }
  fmt::print("  fusion: {} keyframes and {} points placed, {} merges, scale {:.3f} ({:.0f} ms)\n",
             proposal->keyframes.size(), proposal->points.size(), proposal->merges.size(),
             proposal->map_from_other.scale, stopwatch.Milliseconds());
}

Status Run(const Arguments& arguments) {
  const auto vocabulary = Vocabulary::Open(Vocabulary::DefaultPath());
  if (!vocabulary) return vocabulary.error();
  const auto maps = ReadMaps(arguments.files, **vocabulary);
  if (!maps) return maps.error();
  KeyFrameIndex words;
  for (size_t m = 0; m < maps->size(); ++m) {
    const auto& keyframes = (*maps)[m].keyframes();
    for (const auto& [id, keyframe] : keyframes) words.Add(id, WordsOf(keyframe.data), (*maps)[m].id());
    fmt::print("map {}: {}, {} keyframes, {} points, frames {} to {}\n", m + 1, ToString((*maps)[m].id()),
               keyframes.size(), (*maps)[m].points().size(), keyframes.begin()->second.data->frame,
               keyframes.rbegin()->second.data->frame);
  }
  if (maps->size() < 2 || arguments.query > maps->size())
    return Error{"two maps at least are needed, and --query one of them"};
  const size_t query = arguments.query == 0 ? maps->size() - 1 : arguments.query - 1;
  std::vector<OtherMap> others;
  for (size_t m = maps->size(); m-- > 0;) {
    if (m != query) others.push_back(OtherMap::Of((*maps)[m], &words));
  }
  const Map& map = (*maps)[query];
  OverlapDetector detector(arguments.options);
  StageTimes times;
  int confirmed = 0, overlaps = 0;
  for (const auto& [id, keyframe] : map.keyframes()) {
    const Stopwatch stopwatch;
    const OverlapDetection detection = detector.Detect(map, id, keyframe.data->bow, others, nullptr, &times);
    times.Add("lookup", stopwatch.Milliseconds());
    for (const OverlapRefusal& refusal : detection.refusals) {
      if (arguments.verbose)
        fmt::print("frame {}: not {} of map {}: {}\n", keyframe.data->frame, ToString(refusal.candidate),
                   ToString(refusal.other), refusal.reason);
    }
    if (!detection.confirmed) continue;
    ++confirmed;
    overlaps += detection.overlap ? 1 : 0;
    const DetectedOverlap& found = *detection.confirmed;
    const Map& other = *std::find_if(maps->begin(), maps->end(), [&](const Map& m) { return m.id() == found.other; });
    const Sim3d& s = found.other_from_map;
    fmt::print(
        "frame {} sees frame {} of map {}: scale {:.3f}, {:.1f} deg, translation ({:.2f}, {:.2f}, {:.2f}); {}{}\n",
        keyframe.data->frame, other.keyframe(found.matched).data->frame, ToString(found.other), s.scale,
        s.rotation.angularDistance(Eigen::Quaterniond::Identity()) * 180 / M_PI, s.translation.x(), s.translation.y(),
        s.translation.z(), ToString(found.place.evidence), detection.overlap ? "; OVERLAP" : "");
    if (detection.overlap && overlaps == 1 && arguments.fuse) TryFusion(other, map, found);
  }
  fmt::print("{} of {} keyframes see another map, {} overlaps\n", confirmed, map.keyframes().size(), overlaps);
  for (const auto& [stage, samples] : times.samples()) {
    fmt::print("  {:18} {:5} x median {:6.2f} p95 {:6.2f} max {:6.2f} ms\n", stage, samples.size(),
               Quantile(samples, 0.5), Quantile(samples, 0.95), Quantile(samples, 1));
  }
  return Ok{};
}

}  // namespace
}  // namespace portolan

int main(int argc, char** argv) {
  CLI::App app("Overlaps between finished maps, as the atlas_server finds them", "portolan_overlap_replay");
  portolan::Arguments arguments;
  app.add_option("files", arguments.files, "of maps, or atlas.db")->required();
  app.add_option("--query", arguments.query, "which map's keyframes are looked up, by age from 1 (default: the last)");
  app.add_flag("--fuse", arguments.fuse, "propose the fusion that follows from the first overlap");
  app.add_flag("--verbose", arguments.verbose, "print what is refused too");
  app.add_option("--consistent-rounds", arguments.options.consistent_rounds)->capture_default_str();
  app.add_option("--max-verified", arguments.options.max_verified)->capture_default_str();
  if (const auto code = portolan::ParseCommandLine(&app, argc, argv)) return *code;
  const portolan::Status status = portolan::Run(arguments);
  if (!status) fmt::print(stderr, "portolan_overlap_replay: {}\n", status.error().message);
  return status.ok() ? 0 : 1;
}
