#pragma once

#include <string>
#include <vector>

#include "vocabulary/vocabulary_file.h"

namespace portolan {

/// What keeps a vocabulary's nodes alive: a vector of them or a file mapped into memory.
struct Vocabulary::Storage {
  std::vector<Node> nodes;
  void* mapping = nullptr;
  size_t mapping_bytes = 0;

  Storage() = default;
  Storage(const Storage&) = delete;
  Storage& operator=(const Storage&) = delete;
  ~Storage();

  /// Maps a file read-only. @return why it failed, empty if it did not.
  std::string Map(const std::string& path);
};

}  // namespace portolan
