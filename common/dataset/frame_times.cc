#include "dataset/frame_times.h"

#include <fmt/format.h>

#include <filesystem>
#include <optional>

#include "dataset/text_table.h"

namespace portolan {

Result<std::vector<Timestamp>> ReadFrameTimes(const std::string& path) {
  const Result<std::vector<TextRow>> rows = ReadTextTable(path);
  if (!rows) return rows.error();
  const bool nanoseconds = std::filesystem::path(path).extension() == ".csv";
  std::vector<Timestamp> times;
  for (const TextRow& row : *rows) {
    const std::string& field = row.fields[0];
    const std::optional<Timestamp> stamp = nanoseconds ? ParseNanoseconds(field) : ParseSeconds(field);
    if (!stamp || (!times.empty() && *stamp <= times.back())) {
      return Error{fmt::format("{}:{}: expected rising times in {}, found '{}'", path, row.line,
                               nanoseconds ? "nanoseconds" : "seconds", field)};
    }
    times.push_back(*stamp);
  }
  return times;
}

std::string FindFrameTimes(const std::string& groundtruth) {
  const std::filesystem::path folder = std::filesystem::path(groundtruth).parent_path();
  for (const char* name : {"rgb.txt", "times.txt", "../cam0/data.csv"}) {
    const std::filesystem::path path = folder / name;
    if (std::filesystem::is_regular_file(path)) return path.string();
  }
  return "";
}

}  // namespace portolan
