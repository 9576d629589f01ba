#include "processes/status_watch.h"

#include <utility>

namespace portolan {

const ProcessStatus* StatusWatch::Heard::Of(const std::string& role) const {
  const auto process = last_of_role.find(role);
  return process == last_of_role.end() ? nullptr : &processes.at(process->second);
}

const ProcessStatus* StatusWatch::Heard::OfPid(pid_t pid) const {
  for (const auto& [id, status] : processes) {
    if (static_cast<pid_t>(status.pid) == pid) return &status;
  }
  return nullptr;
}

double StatusWatch::Heard::Figure(const std::string& role, const std::string& name) const {
  const ProcessStatus* status = Of(role);
  return status == nullptr ? 0 : FigureOf(*status, name);
}

double FigureOf(const ProcessStatus& status, const std::string& name) {
  for (const auto& [figure, value] : status.figures) {
    if (figure == name) return value;
  }
  return 0;
}

StatusWatch::StatusWatch(DdsVendor vendor, int domain) : StatusWatch(TestBusOptions(vendor, domain)) {}

StatusWatch::StatusWatch(const BusOptions& options) {
  auto bus = MakeBus(options);
  PORTOLAN_CHECK(bus.ok()) << bus.error().message;
  bus_ = std::move(bus).value();
  status_reader_ = bus_->CreateReader<ProcessStatus>(
      [this](ProcessStatus status) {
        std::lock_guard<std::mutex> lock(mutex_);
        heard_.last_of_role[status.role] = status.process;
        heard_.processes[status.process] = std::move(status);
        changed_.notify_all();
      },
      [this](int alive) {
        std::lock_guard<std::mutex> lock(mutex_);
        heard_.alive = alive;
        changed_.notify_all();
      });
  tracker_reader_ = bus_->CreateReader<TrackerState>([this](TrackerState state) {
    std::lock_guard<std::mutex> lock(mutex_);
    heard_.tracker = state;
    changed_.notify_all();
  });
}

bool StatusWatch::WaitUntil(const std::function<bool(const Heard&)>& condition, std::chrono::milliseconds deadline) {
  std::unique_lock<std::mutex> lock(mutex_);
  return changed_.wait_for(lock, deadline, [&] { return condition(heard_); });
}

StatusWatch::Heard StatusWatch::heard() const {
  std::lock_guard<std::mutex> lock(mutex_);
  return heard_;
}

BusOptions TestBusOptions(DdsVendor vendor, int domain) {
  BusOptions options;
  options.vendor = vendor;
  options.domain = domain;
  return options;
}

}  // namespace portolan
