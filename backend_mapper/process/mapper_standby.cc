// Standing by behind another mapper, and leaving the place to one that does. Who has it the atlas_server says.

#include <algorithm>
#include <utility>

#include "process/mapper_process.h"

namespace portolan {
namespace {

/// Many times what the atlas_server takes to decide: one that is gone will not.
constexpr auto kDrainedPatience = std::chrono::seconds(30);

}  // namespace

void MapperProcess::FollowOwner() {
  if (!is_standby_) return;
  for (const SnapshotRequest& request :
       warm_maps_.Update(std::chrono::duration<double>(Clock::now().time_since_epoch()).count()))
    snapshot_writer_->Write(request);
}

void MapperProcess::TellHeld(const HeldMap& held) {
  Request report;
  report.id = request_ids_.Next();
  report.sender = setup_.process;
  report.kind = "holds_map";
  report.map = held.map;
  report.argument = ToText(held);
  request_writer_->Write(report);
}

/// This process ends what it has begun and then stands still; one that stands by tells what it holds.
void MapperProcess::OnDrain(ProcessId process) {
  if (process == setup_.process) {
    spdlog::info("is to leave its place: ends what it has begun");
  } else if (!is_standby_ || !warm_maps_.IsOwner(process)) {
    return;
  }
  draining_ = process;
  warm_maps_.TellAllAgain();
  ContinueDrain();
}

void MapperProcess::ContinueDrain() {
  if (!draining_.IsValid()) return;
  if (draining_ != setup_.process) {
    for (const HeldMap& held : warm_maps_.TakeNews()) TellHeld(held);
    return;
  }
  if (IsDrained()) {
    if (Clock::now() - *drained_since_ > kDrainedPatience) OnAppointment(setup_.process);
    return;
  }
  if (background_.busy() || !takeovers_.empty()) return;
  drained_since_ = Clock::now();
  PublishState(false);
  OnStatusTimer();  // tells what is held, and again each second
}

void MapperProcess::TellAllHeld() {
  for (const auto& [id, mapper] : mappers_) TellHeld(MeasureMap(mapper->map()));
  Request report;
  report.id = request_ids_.Next();
  report.sender = setup_.process;
  report.kind = "drained";
  request_writer_->Write(report);
}

void MapperProcess::OnAppointment(ProcessId process) {
  const bool was_draining = draining_ == setup_.process;
  draining_ = ProcessId();
  drained_since_.reset();
  if (process != setup_.process) {
    if (!was_draining) return;
    spdlog::info("has left its place to {}", ToString(process));
    return loop_->Stop();
  }
  if (was_draining) {
    spdlog::info("goes on: nobody has come in its place");
  } else {
    spdlog::info("has the place of robot {}'s mapper", setup_.options.robot);
  }
  is_standby_ = false;
  PublishState(keyframes_waiting_ == 0);
  OnStatusTimer();
}

std::string MapperProcess::StateInWords() const {
  if (is_standby_ && mappers_.empty()) return kStandbyState;
  if (draining_ == setup_.process) return IsDrained() ? "drained" : "draining";
  if (!mappers_.empty()) return "mapping";
  return registration_ ? "waiting for the atlas_server" : "waiting for a map";
}

size_t MapperProcess::NumKeyFrames() const {
  size_t keyframes = 0;
  for (const auto& [id, mapper] : mappers_) keyframes += mapper->map().keyframes().size();
  const Map* followed = mappers_.empty() ? warm_maps_.current() : nullptr;
  return followed != nullptr ? followed->keyframes().size() : keyframes;
}

}  // namespace portolan
