#include "tool/text_columns.h"

#include <algorithm>
#include <utility>

#include "base/check.h"

namespace portolan {

void TextColumns::Add(std::vector<std::string> cells) {
  PORTOLAN_CHECK(rows_.empty() || cells.size() == rows_[0].size()) << cells.size() << " cells";
  rows_.push_back(std::move(cells));
}

std::string TextColumns::Format() const {
  std::vector<size_t> widths(rows_[0].size(), 0);
  for (const auto& row : rows_) {
    for (size_t i = 0; i < row.size(); ++i) widths[i] = std::max(widths[i], row[i].size());
  }
  std::string text;
  for (const auto& row : rows_) {
    for (size_t i = 0; i + 1 < row.size(); ++i) text += row[i] + std::string(widths[i] - row[i].size() + 2, ' ');
    text += row.back() + "\n";
  }
  return text;
}

}  // namespace portolan
