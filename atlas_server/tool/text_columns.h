#pragma once

#include <string>
#include <utility>
#include <vector>

namespace portolan {

/// A table for a terminal: columns as wide as their widest cell, the last one free.
class TextColumns {
 public:
  explicit TextColumns(std::vector<std::string> head) { Add(std::move(head)); }
  /// @param cells as many as the head has.
  void Add(std::vector<std::string> cells);
  /// Lines, each ended.
  std::string Format() const;

 private:
  std::vector<std::vector<std::string>> rows_;
};

}  // namespace portolan
