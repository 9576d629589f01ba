#include "tool/status_book.h"

#include <fmt/format.h>

#include <algorithm>
#include <iterator>
#include <tuple>

#include "tool/text_columns.h"

namespace portolan {
namespace {

constexpr double kMinIntervalS = 0.2;  // between two statuses: shorter ones make wild rates

/// Figures that are lengths of queues, or work that waits, and how the table calls them.
constexpr std::pair<const char*, const char*> kQueues[] = {{"events_waiting", "events"},
                                                           {"keyframes_waiting", "keyframes"},
                                                           {"unacknowledged_keyframes", "unacknowledged"},
                                                           {"pending_requests", "requests"},
                                                           {"lag", "revisions behind"}};
/// Counters whose rates the table shows.
constexpr std::pair<const char*, const char*> kRates[] = {{"frames", "frames"},
                                                          {"keyframes_taken", "keyframes"},
                                                          {"indexed_keyframes", "keyframes"},
                                                          {"stored_keyframes", "keyframes stored"},
                                                          {"frames_dropped", "frames dropped"},
                                                          {"events_dropped", "events dropped"},
                                                          {"malformed", "malformed"},
                                                          {"lost", "lost"}};
/// Of bytes, in kB/s.
constexpr std::pair<const char*, const char*> kByteRates[] = {{"bytes_sent", "sent"}, {"bytes_received", "received"}};

size_t RankOf(const std::string& role) {
  return static_cast<size_t>(std::find(std::begin(kRoles), std::end(kRoles), role) - std::begin(kRoles));
}

std::map<std::string, double> FiguresOf(const ProcessStatus& status) {
  return {status.figures.begin(), status.figures.end()};
}

std::string Join(const std::vector<std::string>& parts) {
  std::string text;
  for (const std::string& part : parts) text += (text.empty() ? "" : ", ") + part;
  return text.empty() ? "-" : text;
}

/// Of the figures that the process has; those at 0 are shown only when all are.
std::string FormatQueues(const ProcessStatus& status) {
  const auto figures = FiguresOf(status);
  std::vector<std::string> waiting;
  bool has_queues = false;
  for (const auto& [name, word] : kQueues) {
    const auto figure = figures.find(name);
    if (figure == figures.end()) continue;
    has_queues = true;
    if (figure->second > 0) waiting.push_back(fmt::format("{:.0f} {}", figure->second, word));
  }
  return waiting.empty() && has_queues ? "empty" : Join(waiting);
}

std::string FormatRates(const std::map<std::string, double>& rates) {
  std::vector<std::string> shown;
  for (const auto& [name, word] : kRates) {
    const auto rate = rates.find(name);
    if (rate != rates.end() && rate->second >= 0.05) shown.push_back(fmt::format("{:.1f} {}/s", rate->second, word));
  }
  for (const auto& [name, word] : kByteRates) {
    const auto rate = rates.find(name);
    if (rate != rates.end() && rate->second >= 50)
      shown.push_back(fmt::format("{:.1f} kB/s {}", 1e-3 * rate->second, word));
  }
  return Join(shown);
}

}  // namespace

void StatusBook::Hear(const ProcessStatus& status, double now_s) {
  Entry& entry = entries_[status.process];
  const double interval_s = now_s - entry.heard_s;
  if (entry.heard > 0 && interval_s < kMinIntervalS) return;
  if (entry.heard > 1) {
    const auto before = FiguresOf(entry.status);
    entry.rates.clear();
    for (const auto& [name, value] : status.figures) {
      const auto old = before.find(name);
      if (old != before.end() && value > old->second) entry.rates[name] = (value - old->second) / interval_s;
    }
  }
  entry.status = status;
  entry.heard_s = now_s;
  ++entry.heard;
  for (auto other = entries_.begin(); other != entries_.end();)
    other = now_s - other->second.heard_s > kForgottenS ? entries_.erase(other) : std::next(other);
}

std::vector<StatusBook::Heard> StatusBook::Processes(double now_s) const {
  std::vector<Heard> processes;
  for (const Entry* entry : Sorted()) processes.push_back({entry->status, now_s - entry->heard_s});
  return processes;
}

bool StatusBook::HasEveryRole() const {
  return std::all_of(kRoles.begin(), kRoles.end(), [&](const char* role) { return Find(role) != nullptr; });
}

const ProcessStatus* StatusBook::Find(const std::string& role) const {
  const Entry* last = nullptr;
  for (const auto& [id, entry] : entries_) {
    if (entry.status.role == role && (last == nullptr || entry.heard_s > last->heard_s)) last = &entry;
  }
  return last == nullptr ? nullptr : &last->status;
}

std::vector<const StatusBook::Entry*> StatusBook::Sorted() const {
  std::vector<const Entry*> sorted;
  for (const auto& [id, entry] : entries_) sorted.push_back(&entry);
  std::sort(sorted.begin(), sorted.end(), [](const Entry* a, const Entry* b) {
    const auto key = [](const Entry* e) {
      return std::tuple(e->status.process.robot(), RankOf(e->status.role), e->status.process);
    };
    return key(a) < key(b);
  });
  return sorted;
}

std::string StatusBook::Format(double now_s) const {
  TextColumns table({"role", "robot", "host", "pid", "vendor", "priority", "state", "map", "queues", "rates"});
  for (const Entry* entry : Sorted()) {
    const ProcessStatus& status = entry->status;
    const double silent_s = now_s - entry->heard_s;
    const std::string state = silent_s > kSilentS ? fmt::format("silent for {:.0f} s", silent_s) : status.state;
    table.Add({status.role, std::to_string(status.process.robot()), status.host, std::to_string(status.pid),
               status.vendor, status.priority, state,
               status.map.IsValid() ? fmt::format("{} at {}", ToString(status.map), status.revision) : "-",
               FormatQueues(status), FormatRates(entry->rates)});
  }
  return table.Format();
}

nlohmann::json StatusBook::ToJson(double now_s) const {
  nlohmann::json list = nlohmann::json::array();
  for (const Entry* entry : Sorted()) {
    const ProcessStatus& status = entry->status;
    list.push_back({{"process", ToString(status.process)},
                    {"role", status.role},
                    {"robot", status.process.robot()},
                    {"host", status.host},
                    {"pid", status.pid},
                    {"vendor", status.vendor},
                    {"build", status.build},
                    {"priority", status.priority},
                    {"state", status.state},
                    {"map", ToString(status.map)},
                    {"epoch", status.epoch},
                    {"revision", status.revision},
                    {"silent_s", now_s - entry->heard_s},
                    {"figures", FiguresOf(status)},
                    {"rates", entry->rates}});
  }
  return list;
}

}  // namespace portolan
