#pragma once

#include <string>

#include "process/tool_session.h"

namespace portolan {

/// What the command line asks for.
struct ToolArguments {
  std::string map, other;      ///< names of maps; empty where not given
  std::string file;            ///< load
  std::string ply, tum, pmap;  ///< export: files to write
  std::string dot, picture;    ///< graph: files to write
  std::string role;            ///< swap
  std::string robot;           ///< number of the robot meant; empty: the atlas_server finds the one there is
  bool json = false;           ///< status, maps, graph, swap
  bool names = false;          ///< maps: for the shell's completion
  bool watch = false;          ///< status
  std::string listen;          ///< metrics: port, or address and port
  std::string metrics_file;    ///< metrics: file to write
  bool there = false;          ///< load: the file is on the atlas_server's machine
};

// Commands of the tool. They print their result on standard output; a failure goes to the caller, its exit code to the
// session (ToolSession::Fail).

Status ShowStatus(ToolSession* session, const ToolArguments& arguments);
Status ShowMaps(ToolSession* session, const ToolArguments& arguments);
Status ShowGraph(ToolSession* session, const ToolArguments& arguments);
/// Tells the figures of all processes to Prometheus, until the tool is ended.
Status ServeMetrics(ToolSession* session, const ToolArguments& arguments);
Status ExportMap(ToolSession* session, const ToolArguments& arguments);
Status LoadMaps(ToolSession* session, const ToolArguments& arguments);
Status SwapProcess(ToolSession* session, const ToolArguments& arguments);
/// Requests that name nothing but a robot, or nothing at all.
Status SendRequest(ToolSession* session, const std::string& kind, const ToolArguments& arguments);
/// Requests that name a map, or two.
Status SendMapRequest(ToolSession* session, const std::string& kind, const ToolArguments& arguments);

}  // namespace portolan
