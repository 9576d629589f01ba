#include "process/tool_commands.h"

#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <utility>

#include "base/atomic_file.h"
#include "map/map_file.h"
#include "tool/graph_picture.h"
#include "tool/map_export.h"
#include "tool/map_names.h"
#include "tool/swap_report.h"

namespace portolan {
namespace {

constexpr double kRatesS = 3.0;    // three statuses of each process, one a second
constexpr double kMissedS = 6.0;   // a participant whose announcement was lost is heard of within two more (3 s apart)
constexpr double kRefreshS = 1.0;  // of --watch
constexpr double kSwapS = 30.0;    // longer than the atlas_server gives it
constexpr double kJoinS = 90.0;    // the same, of what JoinOptions gives a switch or fusion

void Print(const std::string& text) {
  std::fwrite(text.data(), 1, text.size(), stdout);
  std::fflush(stdout);
}

void PrintOk(const Reply& reply) {
  Print(reply.text.empty() ? "ok\n" : "ok: " + reply.text + "\n");
}

/// The list, and in it the map that a name means.
Result<std::pair<MapList, MapId>> Choose(ToolSession* session, const std::string& name) {
  Result<MapList> list = session->ListMaps();
  if (!list) return list.error();
  const Result<MapId> map = ChooseMap(name, list->Ids(), list->last);
  if (!map) return session->Fail(kExitBadInput, map.error().message);
  return std::pair(std::move(*list), *map);
}

std::string HostName() {
  char host[256] = "";
  gethostname(host, sizeof host - 1);
  return host;
}

/// The one map that a mapper works on, of the robot if one is given.
Result<MapId> ChooseActive(ToolSession* session, const std::string& robot) {
  const Result<MapList> list = session->ListMaps();
  if (!list) return list.error();
  std::vector<MapId> active;
  for (const MapList::Entry& entry : list->maps) {
    if (entry.is_active && (robot.empty() || std::to_string(entry.robot) == robot)) active.push_back(entry.map);
  }
  if (active.size() == 1) return active[0];
  return session->Fail(kExitBadInput, active.empty() ? "no map is active: name one"
                                                     : std::to_string(active.size()) + " maps are active: name one");
}

}  // namespace

Status ShowStatus(ToolSession* session, const ToolArguments& arguments) {
  const StatusBook& book = session->book();
  if (!session->Listen(session->timeout_s(), [&] { return book.size() > 0; }))
    return session->Fail(kExitUnreachable, "no process was heard");
  const auto show = [&] {
    const double now_s = ToolSession::Now();
    Print(arguments.json ? book.ToJson(now_s).dump(arguments.watch ? -1 : 2) + "\n" : book.Format(now_s));
  };
  // Nobody knows how many there are, and one may be discovered seconds after the others: until none was for so long.
  // Where a role is missing, somebody may be on the way.
  size_t heard = 0;
  do {
    heard = book.size();
  } while (session->Listen(book.HasEveryRole() ? kRatesS : kMissedS, [&] { return book.size() > heard; }));
  show();
  while (arguments.watch) {
    session->Listen(kRefreshS, [] { return false; });
    if (!arguments.json && isatty(STDOUT_FILENO) == 1) Print("\033[H\033[2J");  // home, clear
    show();
  }
  return Ok{};
}

Status ShowMaps(ToolSession* session, const ToolArguments& arguments) {
  const Result<Reply> reply = session->Ask("list_maps");
  if (!reply) return reply.error();
  if (arguments.json) {
    Print(reply->text + "\n");
    return Ok{};
  }
  const Result<MapList> list = ParseMapList(reply->text);
  if (!list) return list.error();
  if (!arguments.names) {
    Print(FormatMapList(*list));
    return Ok{};
  }
  for (const MapId map : list->Ids()) Print(ToString(map) + "\n");
  return Ok{};
}

Status ShowGraph(ToolSession* session, const ToolArguments& arguments) {
  const Result<Reply> reply = session->Ask("map_graph");
  if (!reply) return reply.error();
  const Result<DescribedGraph> graph = ParseMapGraph(reply->text);
  if (!graph) return graph.error();
  if (!arguments.dot.empty()) {
    if (Status written = WriteFileAtomically(arguments.dot, ToDot(graph->graph, graph->labels)); !written)
      return written;
  }
  if (!arguments.picture.empty()) {
    if (Status written = DrawMapGraph(*graph).Write(arguments.picture); !written) return written;
  }
  if (arguments.json) Print(reply->text + "\n");
  if (!arguments.json && arguments.dot.empty() && arguments.picture.empty()) Print(FormatMapGraph(*graph));
  return Ok{};
}

Status ExportMap(ToolSession* session, const ToolArguments& arguments) {
  const auto chosen = Choose(session, arguments.map);
  if (!chosen) return chosen.error();
  const Result<Map> map = session->FetchMap(*chosen->first.Find(chosen->second));
  if (!map) return map.error();
  const std::pair<const std::string&, std::function<Status(const std::string&)>> forms[] = {
      {arguments.ply, [&](const std::string& path) { return WriteMapPly(path, *map); }},
      {arguments.tum, [&](const std::string& path) { return WriteKeyFrameTrajectory(path, *map); }},
      {arguments.pmap, [&](const std::string& path) { return WriteMapFile(path, {&*map}); }}};
  for (const auto& [path, write] : forms) {
    if (path.empty()) continue;
    if (Status written = write(path); !written) return written;
    Print("map " + ToString(map->id()) + " at revision " + std::to_string(map->revision()) + ", " +
          std::to_string(map->keyframes().size()) + " keyframes, " + std::to_string(map->points().size()) +
          " points: " + path + "\n");
  }
  return Ok{};
}

Status LoadMaps(ToolSession* session, const ToolArguments& arguments) {
  std::string path = arguments.file;
  if (!arguments.there) {
    const auto atlas = [&] { return session->book().Find("atlas_server"); };
    if (session->Listen(session->timeout_s(), [&] { return atlas() != nullptr; }) && atlas()->host != HostName()) {
      return session->Fail(kExitBadInput, "the atlas_server runs on host '" + atlas()->host + "', this is '" +
                                              HostName() +
                                              "': copy the file there and give its path on that host, with --there");
    }
    if (access(path.c_str(), R_OK) != 0) return session->Fail(kExitBadInput, "'" + path + "' can't be read");
    path = std::filesystem::absolute(path).lexically_normal();
  }
  const Result<Reply> reply = session->Ask("import_map", MapId(), MapId(), path);
  if (!reply) return reply.error();
  PrintOk(*reply);
  return Ok{};
}

Status SwapProcess(ToolSession* session, const ToolArguments& arguments) {
  // Whether there is one that answers.
  if (const Result<MapList> list = session->ListMaps(); !list) return list.error();
  session->BePatient(kSwapS);
  const Result<Reply> reply =
      session->Ask("swap", MapId(), MapId(), arguments.role == "mapper" ? "backend_mapper" : arguments.role);
  if (!reply) return reply.error();
  const Result<SwapReport> report = ParseSwapReport(reply->text);
  if (!report) return session->Fail(kExitFailure, report.error().message);
  Print(arguments.json ? reply->text + "\n" : FormatSwapReport(*report));
  if (const std::string problem = report->Problem(); !problem.empty()) return session->Fail(kExitFailure, problem);
  return Ok{};
}

Status SendRequest(ToolSession* session, const std::string& kind, const ToolArguments& arguments) {
  const Result<Reply> reply = session->Ask(kind, MapId(), MapId(), arguments.robot);
  if (!reply) return reply.error();
  PrintOk(*reply);
  return Ok{};
}

Status SendMapRequest(ToolSession* session, const std::string& kind, const ToolArguments& arguments) {
  MapId map, other;
  if (arguments.map.empty()) {
    const Result<MapId> active = ChooseActive(session, arguments.robot);
    if (!active) return active.error();
    map = *active;
  } else {
    const auto chosen = Choose(session, arguments.map);
    if (!chosen) return chosen.error();
    map = chosen->second;
    if (!arguments.other.empty()) {
      const Result<MapId> second = ChooseMap(arguments.other, chosen->first.Ids(), chosen->first.last);
      if (!second) return session->Fail(kExitBadInput, second.error().message);
      other = *second;
    }
  }
  if (kind == "activate" || kind == "fuse") session->BePatient(kJoinS);  // they are answered when they are done
  const Result<Reply> reply = session->Ask(kind, map, other, arguments.robot);
  if (!reply) return reply.error();
  PrintOk(*reply);
  return Ok{};
}

}  // namespace portolan
