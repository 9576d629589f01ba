#include "tool/metrics.h"

#include <fmt/format.h>

#include <cmath>
#include <map>
#include <set>
#include <utility>
#include <vector>

namespace portolan {
namespace {

struct Metric {
  const char* figure;  ///< of ProcessStatus::figures
  const char* name;    ///< without "portolan_"; a counter if it ends in "_total"
  const char* help;
};

constexpr Metric kMetrics[] = {
    {"resident_bytes", "resident_memory_bytes", "Memory of the process in RAM."},
    {"open_files", "open_file_descriptors", "Files, sockets and pipes that the process has open."},
    {"cpu_s", "cpu_seconds_total", "Time that the process computed, user and system, over all threads."},
    {"frames", "frames_total", "Frames that the tracker has looked at."},
    {"tracked", "frames_tracked_total", "Frames whose pose was found."},
    {"frames_dropped", "frames_dropped_total", "Frames that came too fast and were passed over."},
    {"frames_unreadable", "frames_unreadable_total", "Frames that could not be decoded."},
    {"takes_orders", "tracker_takes_orders", "Whether the tracker has begun, and is not at its end."},
    {"paused", "tracker_paused", "Whether the tracker was told to take no more frames."},
    {"localization_only", "tracker_localization_only", "Whether the tracker was told to change no map."},
    {"switches", "map_switches_total", "Times that the tracker went on in an earlier map."},
    {"refused_moves", "refused_moves_total", "Maps that the tracker was told to go into and could not."},
    {"links", "map_links", "Pairs of maps of which the tracker knows how they lie to each other."},
    {"maps", "maps", "Maps that the process holds."},
    {"keyframes", "keyframes", "Keyframes of the maps that the process holds."},
    {"points", "points", "Points of the maps that the process holds."},
    {"covisibility_edges", "covisibility_edges", "Pairs of keyframes that see common points."},
    {"unacknowledged_keyframes", "unacknowledged_keyframes",
     "Keyframes that the tracker keeps until a map holds them."},
    {"keyframes_taken", "keyframes_taken_total", "Keyframes that the mapper has taken into its maps."},
    {"keyframes_refused", "keyframes_refused_total", "Keyframes that the mapper refused."},
    {"keyframes_waiting", "keyframes_waiting", "Keyframes that wait for the mapper."},
    {"early_dropped", "early_keyframes_dropped_total", "Keyframes of maps that were not granted in time."},
    {"interrupts", "interrupted_adjustments_total", "Local bundle adjustments that a new keyframe cut short."},
    {"corrections", "corrections_applied_total", "Corrections that the mapper applied."},
    {"fusions", "map_fusions_total", "Maps that became one."},
    {"indexed_keyframes", "indexed_keyframes", "Keyframes among which loops are looked for."},
    {"loops", "loops_closed_total", "Loops that were closed."},
    {"loop_candidates", "loop_candidates_total", "Keyframes that by their words may show a place again."},
    {"loop_refusals", "loops_refused_total", "Loops that were verified and refused."},
    {"global_ba", "global_adjustments_total", "Global bundle adjustments."},
    {"forward_ba", "forward_adjustments_total", "Forward bundle adjustments."},
    {"lag", "revisions_behind", "Revisions by which a replica is behind the map's owner."},
    {"stored_keyframes", "stored_keyframes", "Keyframes in the atlas's store."},
    {"store_failures", "store_failures_total", "Times that the store could not be written."},
    {"maps_paged", "maps_paged", "Maps of which memory has words alone, until more of them is needed."},
    {"map_loads", "map_loads_total", "Paged maps that were read from the store again."},
    {"map_load_failures", "map_load_failures_total", "Paged maps that could not be read."},
    {"pending_requests", "pending_requests", "Requests that the atlas_server has not answered yet."},
    {"grants", "grants_total", "Times that a map was given to an owner."},
    {"takeovers", "takeovers_total", "Maps that were taken from an owner that died."},
    {"snapshots_sent", "snapshots_sent_total", "Whole maps that were sent to who asked."},
    {"snapshots_asked", "snapshots_asked_total", "Whole maps that the process asked for."},
    {"foreign_vocabulary", "foreign_vocabulary_total", "Messages made with another vocabulary, and refused."},
    {"foreign_keyframes", "foreign_keyframes_total", "Keyframes made with another vocabulary, and refused."},
    {"events_waiting", "events_waiting", "Events in the queue of the process."},
    {"events_dropped", "events_dropped_total", "Events that found the queue full."},
    {"malformed", "malformed_messages_total", "Messages that failed validation, and were dropped."},
    {"send_failures", "send_failures_total", "Messages that DDS did not take within the topic's time."},
    {"lost", "lost_messages_total", "Messages that DDS reported lost or rejected."},
};

/// A label's value: what the format takes for its own is escaped.
std::string Quoted(const std::string& text) {
  std::string quoted = "\"";
  for (const char c : text) {
    if (c == '\\' || c == '"') quoted += '\\';
    quoted += c == '\n' ? std::string("\\n") : std::string(1, c);
  }
  return quoted + "\"";
}

std::string Value(double value) {
  if (std::isnan(value)) return "NaN";
  if (std::isinf(value)) return value > 0 ? "+Inf" : "-Inf";
  return fmt::format("{}", value);
}

bool EndsWith(const std::string& text, const std::string& end) {
  return text.size() >= end.size() && text.compare(text.size() - end.size(), end.size(), end) == 0;
}

/// Collects samples metric by metric: the format wants those of one together, after its HELP and TYPE.
class Exposition {
 public:
  void Add(const std::string& name, const std::string& help, const std::string& labels, double value) {
    auto [found, is_new] = index_.emplace(name, blocks_.size());
    if (is_new) {
      const char* type = EndsWith(name, "_total") ? "counter" : "gauge";
      blocks_.push_back(fmt::format("# HELP portolan_{0} {1}\n# TYPE portolan_{0} {2}\n", name, help, type));
    }
    blocks_[found->second] += fmt::format("portolan_{}{{{}}} {}\n", name, labels, Value(value));
  }
  std::string Text() const {
    std::string text;
    for (const std::string& block : blocks_) text += block;
    return text;
  }

 private:
  std::map<std::string, size_t> index_;
  std::vector<std::string> blocks_;
};

void AddProcess(const StatusBook::Heard& heard, Exposition* exposition) {
  const ProcessStatus& status = heard.status;
  const std::string labels = fmt::format("role={},robot=\"{}\",host={},process={}", Quoted(status.role),
                                         status.process.robot(), Quoted(status.host), Quoted(ToString(status.process)));
  exposition->Add("process_info", "What the process is; always 1.",
                  labels + fmt::format(",pid=\"{}\",vendor={},build={},priority={}", status.pid, Quoted(status.vendor),
                                       Quoted(status.build), Quoted(status.priority)),
                  1);
  exposition->Add("process_up", "Whether the process has told of itself in the last seconds.", labels,
                  heard.silent_s <= StatusBook::kSilentS);
  exposition->Add("process_silent_seconds", "Time since the process last told of itself.", labels, heard.silent_s);
  exposition->Add("map_revision", "Revision of the map that the process is at.", labels,
                  static_cast<double>(status.revision));
  exposition->Add("map_epoch", "Epoch of that map: how often it changed its owner.", labels,
                  static_cast<double>(status.epoch));
  std::map<std::string, double> figures(status.figures.begin(), status.figures.end());
  for (const Metric& metric : kMetrics) {
    const auto figure = figures.find(metric.figure);
    if (figure == figures.end()) continue;
    exposition->Add(metric.name, metric.help, labels, figure->second);
    figures.erase(figure);
  }
  // A process of a newer build may tell what this one has no name for.
  for (const auto& [name, value] : figures)
    exposition->Add("figure", "Figures that have no metric of their own.", labels + ",figure=" + Quoted(name), value);
}

}  // namespace

std::string FormatMetrics(const StatusBook& book, double now_s) {
  Exposition exposition;
  std::map<std::string, int> alive;
  for (const char* role : kRoles) alive[role] = 0;
  const std::vector<StatusBook::Heard> processes = book.Processes(now_s);
  for (const StatusBook::Heard& heard : processes) alive[heard.status.role] += heard.silent_s <= StatusBook::kSilentS;
  for (const auto& [role, count] : alive)
    exposition.Add("processes", "Processes of a role that are up.", "role=" + Quoted(role), count);
  for (const StatusBook::Heard& heard : processes) AddProcess(heard, &exposition);
  return exposition.Text();
}

}  // namespace portolan
