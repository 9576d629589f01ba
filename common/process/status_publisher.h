#pragma once

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "process/process_setup.h"
#include "transport/bus.h"

namespace portolan {

/// Publishes a process's word about itself on process_status, and asserts its liveliness. To be called from the worker
/// thread: a worker that hangs is to be noticed.
class StatusPublisher {
 public:
  StatusPublisher(Bus* bus, const ProcessSetup& setup, const std::string& priority);

  /// What changes: the state in words, the map it works on, and figures by name. The bus's bytes and drops are added.
  void Publish(const std::string& state, MapId map, Epoch epoch, Revision revision,
               std::vector<std::pair<std::string, double>> figures);
  void AssertLiveliness() { writer_->AssertLiveliness(); }

 private:
  Bus* bus_;
  ProcessStatus fixed_;
  std::unique_ptr<Writer<ProcessStatus>> writer_;
};

}  // namespace portolan
