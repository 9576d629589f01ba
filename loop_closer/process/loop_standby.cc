// Standing by behind another loop_closer, and leaving the place to one that does. Who has it the atlas_server says.

#include "process/loop_process.h"

namespace portolan {
namespace {

/// Many times what the atlas_server takes to decide: one that is gone will not.
constexpr auto kDrainedPatience = std::chrono::seconds(30);

}  // namespace

/// This process ends the loop that it is closing and begins nothing; one that stands by tells how far it is.
void LoopProcess::OnDrain(ProcessId process) {
  if (process != setup_.process && !is_standby_) return;
  if (process == setup_.process) {
    spdlog::info("is to leave its place: ends what it has begun");
    closer_.SetActive(false);
  }
  draining_ = process;
  told_ = HeldMap();
  ContinueDrain(false);
}

void LoopProcess::OnAppointment(ProcessId process) {
  const bool was_draining = draining_ == setup_.process;
  draining_ = ProcessId();
  drained_since_.reset();
  if (process != setup_.process && was_draining) {
    spdlog::info("has left its place to {}", ToString(process));
    return loop_->Stop();
  }
  if (process == setup_.process && is_standby_)
    spdlog::info("has the place of robot {}'s loop_closer", setup_.options.robot);
  is_standby_ = process != setup_.process;  // one that slept, and was given up
  if (closer_.is_active() == is_standby_) closer_.SetActive(!is_standby_);
  OnStatusTimer();
}

/// @param all tells again what was told.
void LoopProcess::ContinueDrain(bool all) {
  if (!draining_.IsValid()) return;
  if (is_standby_) return TellHeld();
  if (drained_since_ && Clock::now() - *drained_since_ > kDrainedPatience) return OnAppointment(setup_.process);
  if (!closer_.IsAtRest() || (drained_since_ && !all)) return;
  if (!drained_since_) drained_since_ = Clock::now();
  told_ = HeldMap();
  TellHeld();
  Report("drained", MapId(), "");
}

/// What is here of the active map, if that is new.
void LoopProcess::TellHeld() {
  const Map* map = closer_.follower().Find(closer_.follower().active_map());
  if (map == nullptr || (map->id() == told_.map && map->epoch() == told_.epoch && map->revision() == told_.revision))
    return;
  told_ = MeasureMap(*map);
  Report("holds_map", told_.map, ToText(told_));
}

void LoopProcess::Report(const std::string& kind, MapId map, const std::string& argument) {
  Request report;
  report.id = request_ids_.Next();
  report.sender = setup_.process;
  report.kind = kind;
  report.map = map;
  report.argument = argument;
  request_writer_->Write(report);
}

std::string LoopProcess::StateInWords(bool has_map) const {
  if (is_standby_) return kStandbyState;
  if (draining_ == setup_.process) return drained_since_ ? "drained" : "draining";
  return has_map ? "following" : "waiting for a map";
}

}  // namespace portolan
