#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "base/result.h"

namespace portolan {

/// One value of a YAML file, under the names of its sections joined by dots: "tracker.num_features".
struct YamlEntry {
  std::string key;
  int line = 0;  ///< of the key, from 1
  bool is_list = false;
  std::vector<std::string> values;  ///< a scalar's one text, or a list's; none for a key without a value
};

/// Reads one YAML document of nested maps whose leaves are scalars or flat lists, in the order of the file. An empty
/// document has no entries. Fails with "name:line: ..." on a syntax error, a key given twice, a key that is not plain
/// text, a list that holds anything but scalars, a second document, maps nested too deep.
/// @param name how messages call it: the file's path.
Result<std::vector<YamlEntry>> ParseFlatYaml(const std::string& text, const std::string& name);

/// A file's bytes as text; fails with the path and the system's reason.
Result<std::string> ReadTextFile(const std::string& path);

/// The whole text as one number. None when it is not a number, has something after it, is out of the type's range or
/// not finite.
bool ParseNumber(const std::string& text, double* value);
bool ParseNumber(const std::string& text, int64_t* value);

/// The candidate with the fewest edits (insert, delete, replace) from `word`, if that is no more than a third of its
/// length; else empty. The first of equals.
std::string NearestWord(const std::string& word, const std::vector<std::string>& candidates);

}  // namespace portolan
