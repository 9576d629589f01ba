// An atlas_server that stands by behind another, and one that leaves its place to it.

#include <algorithm>
#include <utility>

#include "process/atlas_process.h"
#include "tool/map_list.h"

namespace portolan {
namespace {

/// Longer silences of its own: it was stopped, and what it has not heard meanwhile tells nothing.
constexpr double kAsleepS = 0.75;
/// For the one that leaves to close the file; with one that hangs it stays closed to us, and the rest goes on.
constexpr double kStorePatienceS = 2.0;
constexpr double kLastWordsS = 1.0;  // for the readers to acknowledge them
/// For a first word of the one that has the place: on Fast DDS two participants whose first announcements were lost
/// find each other with the next, 3 s later; twice that and a status.
constexpr double kDiscoveryS = 8.0;

}  // namespace

void AtlasProcess::ConnectStandby() {
  request_writer_ = bus_->CreateWriter<Request>();
  readers_.push_back(bus_->CreateReader<Reply>(
      [this](Reply reply) { loop_->Post([this, reply = std::move(reply)] { OnReply(reply); }); }));
  awake_since_s_ = Now();
}

/// Dormant maps nobody else speaks of: their states, who owns what, and the graph come from the other's lists.
void AtlasProcess::AskForList() {
  for (const auto& [kind, asked] : {std::pair("list_maps", &asked_list_), std::pair("map_graph", &asked_graph_)}) {
    Request request;
    request.id = *asked = request_ids_.Next();
    request.sender = setup_.process;
    request.kind = kind;
    request_writer_->Write(request);
  }
}

void AtlasProcess::OnReply(const Reply& reply) {
  if (!atlas_.is_standby() || !reply.ok) return;
  if (reply.id == asked_list_) TakeUpList(reply.text);
  if (reply.id == asked_graph_) TakeUpGraph(reply.text);
}

void AtlasProcess::TakeUpList(const std::string& text) {
  const Result<MapList> list = ParseMapList(text);
  if (!list) {
    if (store_log_.Allow()) spdlog::error("{}", list.error().message);
    return;
  }
  const ProcessId holder = atlas_.HolderOf(Atlas::kAtlasRole, 0, Now());
  std::vector<Atlas::Ownership> ownerships;
  for (const MapList::Entry& entry : list->maps) {
    const Atlas::Ownership ownership{entry.map, entry.robot, entry.epoch, entry.owner};
    const auto known = atlas_.maps().find(entry.map);
    const bool is_new =
        known == atlas_.maps().end() || known->second.epoch != entry.epoch || known->second.owner != entry.owner;
    ownerships.push_back(ownership);
    if (is_new && store_ != nullptr && entry.epoch > 0) {
      if (Status saved = store_->SaveOwnership(ownership); !saved) NoteStoreFailure(saved.error());
    }
    const bool is_in_file = open_later_ && entry.owner == holder;  // dormant: it will be read there
    if (entry.revision > 0 && !is_in_file) shelf_.Announce(entry.map, entry.state_epoch, entry.revision);
  }
  atlas_.Follow(ownerships);
}

void AtlasProcess::TakeUpGraph(const std::string& text) {
  if (text == graph_text_) return;
  const Result<DescribedGraph> described = ParseMapGraph(text);
  if (!described) {
    if (store_log_.Allow()) spdlog::error("{}", described.error().message);
    return;
  }
  graph_text_ = text;
  atlas_.Follow(described->graph);
  saved_graph_ = 0;
}

void AtlasProcess::OnCommand(const Command& command) {
  if (command.sender == setup_.process) return;
  if (!atlas_.is_standby()) {
    if (command.kind != CommandKind::kAppointAtlasServer || command.owner == setup_.process) return;
    spdlog::error("{} has this atlas_server's place", atlas_.Describe(command.owner));
    atlas_.StandBy();
    has_left_ = true;
    exit_code_ = kExitRefused;
    return loop_->Stop();
  }
  switch (command.kind) {
    case CommandKind::kGrantOwnership: {
      const auto known = atlas_.maps().find(command.map);
      const RobotId robot = known == atlas_.maps().end() ? command.map.robot() : known->second.robot;
      return atlas_.Follow({{command.map, robot, command.epoch, command.owner}});
    }
    case CommandKind::kForgetMap:
      atlas_.FollowDeletion(command.map);
      shelf_.Remove(command.map);
      if (!saver_) return;
      saver_->Forget(command.map);
      if (Status deleted = store_->DeleteMap(command.map); !deleted) NoteStoreFailure(deleted.error());
      return;
    case CommandKind::kDrain:
      if (command.owner != command.sender) return;  // another's
      is_telling_ = true;
      told_.clear();
      return TellHeld();
    case CommandKind::kAppointAtlasServer:
      is_telling_ = false;
      if (command.owner == setup_.process) TakePlace();
      return;
    default:
      return;
  }
}

void AtlasProcess::TellHeld() {
  for (const MapId id : shelf_.Ids()) {
    const MapShelf::Figures figures = *shelf_.FiguresOf(id);
    const std::pair state(figures.epoch, figures.revision);
    if (told_[id] == state) continue;
    told_[id] = state;
    Request report;
    report.id = request_ids_.Next();
    report.sender = setup_.process;
    report.kind = "holds_map";
    report.map = id;
    report.argument = ToText(*shelf_.Measure(id));
    request_writer_->Write(report);
  }
}

void AtlasProcess::StandByTick() {
  if (has_left_) return;
  if (Now() - last_tick_s_ > kAsleepS) awake_since_s_ = Now();
  last_tick_s_ = Now();
  has_heard_holder_ = has_heard_holder_ || atlas_.HolderOf(Atlas::kAtlasRole, 0, Now()).IsValid();
  if (is_telling_) TellHeld();
  if (taking_place_since_s_ || IsLeftAlone()) TakePlace();
}

/// Of several that stand by the first has the place.
bool AtlasProcess::IsLeftAlone() const {
  const double silence_s = Now() - awake_since_s_;
  if (silence_s < (has_heard_holder_ ? Atlas::kAdoptAfterS : kDiscoveryS) ||
      atlas_.HolderOf(Atlas::kAtlasRole, 0, Now()).IsValid())
    return false;
  const std::vector<ProcessId> others = atlas_.StandbysOf(Atlas::kAtlasRole, 0, Now());
  return std::all_of(others.begin(), others.end(), [this](ProcessId other) { return setup_.process < other; });
}

/// With what is in the file, if the other had it.
void AtlasProcess::TakePlace() {
  if (!taking_place_since_s_) taking_place_since_s_ = Now();
  if (open_later_) OpenStoreNow();
  if (open_later_ && Now() - *taking_place_since_s_ < kStorePatienceS) return;
  spdlog::info("has the place of the atlas_server, after {:.2f} s", Now() - *taking_place_since_s_);
  SaveOwnerships();
  atlas_.Promote(Now());
  atlas_.Tell(CommandKind::kAppointAtlasServer, setup_.options.robot, setup_.process);
  PublishDecisions();
  OnStatusTimer();
}

void AtlasProcess::OpenStoreNow() {
  Result<std::unique_ptr<MapStore>> opened = open_later_();
  if (!opened) {
    if (store_log_.Allow()) spdlog::warn("{}", opened.error().message);
    return;
  }
  open_later_ = nullptr;
  store_ = std::move(*opened);
  store_path_ = store_->path();
  saver_.emplace(store_.get(), options_.store_interval_s);
  if (Status loaded = LoadStore(); !loaded) NoteStoreFailure(loaded.error());
  SaveOwnerships();
}

void AtlasProcess::SaveOwnerships() {
  if (store_ == nullptr) return;
  for (const auto& [id, ownership] : atlas_.maps()) {
    if (ownership.epoch == 0) continue;
    if (Status saved = store_->SaveOwnership(ownership); !saved) return NoteStoreFailure(saved.error());
  }
}

/// All is stored and the file closed before the other is told.
void AtlasProcess::LeaveIfAsked() {
  if (!succession_.MayLeave()) return;
  PublishDecisions();
  if (Status saved = SaveAll(); !saved) return succession_.Stay(saved.error().message);
  if (saver_) DropWhatIsStored();
  saver_.reset();
  store_.reset();
  succession_.Leave(Now());
  PublishDecisions();
  atlas_.StandBy();  // says nothing more
  has_left_ = true;
  command_writer_->WaitForAcknowledgments(kLastWordsS);
  reply_writer_->WaitForAcknowledgments(kLastWordsS);
  spdlog::info("has left its place");
  loop_->Stop();
}

size_t AtlasProcess::NumMissingMaps() const {
  return static_cast<size_t>(std::count_if(shelf_.maps().begin(), shelf_.maps().end(), [this](const auto& entry) {
    return entry.second.map().revision() == 0 && shelf_.replicas().IsBehind(entry.first);
  }));
}

Revision AtlasProcess::Lag() const {
  Revision lag = 0;
  for (const auto& [id, replica] : shelf_.maps()) lag = std::max(lag, shelf_.replicas().Lag(id));
  return lag;
}

}  // namespace portolan
