#include "dataset/loop_closures.h"

#include <fmt/format.h>

#include <cstdint>
#include <limits>
#include <nlohmann/json.hpp>

#include "base/flat_yaml.h"

namespace portolan {
namespace {

using nlohmann::json;

/// The value of an object's key; null if there is none, or `object` is none.
const json* Find(const json& object, const char* key) {
  const auto found = object.find(key);
  return found == object.end() ? nullptr : &*found;
}

/// @param place of the object, for messages: "file: closures[3]".
Result<Timestamp> ReadStamp(const json& object, const char* key, const std::string& place) {
  const json* value = Find(object, key);
  if (value == nullptr) return Error{fmt::format("{}.{}: missing, expected integer nanoseconds", place, key)};
  const bool is_beyond = value->is_number_unsigned() &&
                         value->get<uint64_t>() > static_cast<uint64_t>(std::numeric_limits<int64_t>::max());
  if (!value->is_number_integer() || is_beyond) {
    return Error{fmt::format("{}.{}: {}, expected integer nanoseconds", place, key, value->dump())};
  }
  return Timestamp{value->get<int64_t>()};
}

}  // namespace

Result<std::vector<LoopClosure>> ReadLoopClosures(const std::string& path) {
  const Result<std::string> text = ReadTextFile(path);
  if (!text) return text.error();
  json file;
  try {
    file = json::parse(*text);
  } catch (const json::parse_error& failure) {
    return Error{path + ": " + failure.what()};
  }
  const json* list = Find(file, "closures");
  if (list == nullptr) return Error{path + ": closures: missing, expected an array"};
  if (!list->is_array()) return Error{path + ": closures: " + list->type_name() + ", expected an array"};
  std::vector<LoopClosure> closures;
  size_t index = 0;
  for (const json& entry : *list) {
    const std::string place = fmt::format("{}: closures[{}]", path, index);
    if (!entry.is_object()) return Error{fmt::format("{}: {}, expected an object", place, entry.type_name())};
    const json* applied = Find(entry, "applied");
    if (applied != nullptr && !applied->is_boolean()) {
      return Error{fmt::format("{}.applied: {}, expected true or false", place, applied->dump())};
    }
    const Result<Timestamp> stamp = ReadStamp(entry, "stamp_ns", place);
    if (!stamp) return stamp.error();
    const Result<Timestamp> matched_stamp = ReadStamp(entry, "matched_stamp_ns", place);
    if (!matched_stamp) return matched_stamp.error();
    if (applied == nullptr || applied->get<bool>()) closures.push_back({*stamp, *matched_stamp});
    ++index;
  }
  return closures;
}

}  // namespace portolan
