#pragma once

#include <memory>
#include <optional>
#include <string>

#include "process/process_setup.h"
#include "transport/process_loop.h"
#include "vocabulary/vocabulary.h"

namespace portolan {

/// What every process works with, from its setup to its end.
///
///   const ProcessSetup setup = ProcessSetup::Make(...);
///   if (setup.exit_code) return *setup.exit_code;
///   const ProcessStart start = ProcessStart::Make(setup);
///   if (start.exit_code) return *start.exit_code;
class ProcessStart {
 public:
  /// What of the vocabulary a role needs: its words, or its hash alone, which takes no memory.
  enum class Words { kAll, kHashAlone };

  /// Opens the vocabulary, takes the signals over, warns of kernel limits, sets the priority and joins DDS. Before any
  /// other thread is started. On failure, told in the log, `exit_code` is set and nothing else holds.
  static ProcessStart Make(const ProcessSetup& setup, Words words = Words::kAll);

  std::optional<int> exit_code;
  std::shared_ptr<const Vocabulary> vocabulary;  ///< null with Words::kHashAlone
  uint64_t vocabulary_hash = 0;
  std::unique_ptr<ProcessLoop> loop;
  std::string priority;  ///< in force, in words
  std::unique_ptr<Bus> bus;
};

}  // namespace portolan
