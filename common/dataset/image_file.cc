#include "dataset/image_file.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <filesystem>
#include <string_view>
#include <vector>

#include "base/flat_yaml.h"
#include "dataset/image_decoding.h"

namespace portolan {
namespace {

constexpr std::string_view kJpegStart = "\xff\xd8\xff";
constexpr std::string_view kJpegEnd = "\xff\xd9";
constexpr std::string_view kPngStart = "\x89PNG\r\n\x1a\n";
constexpr std::string_view kPngEnd = "IEND\xae\x42\x60\x82";
/// Some cameras pad a file after its last marker; further back than this it would be an embedded thumbnail's.
constexpr size_t kMaxPadding = 64;

bool EndsWithMarker(std::string_view bytes, std::string_view marker) {
  const std::string_view tail = bytes.substr(bytes.size() - std::min(bytes.size(), kMaxPadding + marker.size()));
  return tail.find(marker) != std::string_view::npos;
}

bool IsCutShort(std::string_view bytes) {
  if (bytes.substr(0, kJpegStart.size()) == kJpegStart) return !EndsWithMarker(bytes, kJpegEnd);
  if (bytes.substr(0, kPngStart.size()) == kPngStart) return !EndsWithMarker(bytes, kPngEnd);
  return false;
}

/// End of the run of digits that starts at `from`.
size_t DigitsEnd(const std::string& text, size_t from) {
  while (from < text.size() && std::isdigit(static_cast<unsigned char>(text[from]))) ++from;
  return from;
}

/// Runs of digits compare by value, the rest letter by letter; names that then are equal ("1.png", "01.png") by plain
/// order.
bool NaturalLess(const std::string& a, const std::string& b) {
  size_t i = 0;
  size_t j = 0;
  while (i < a.size() && j < b.size()) {
    const size_t a_end = DigitsEnd(a, i);
    const size_t b_end = DigitsEnd(b, j);
    if (a_end == i || b_end == j) {
      if (a[i] != b[j]) return a[i] < b[j];
      ++i;
      ++j;
      continue;
    }
    const size_t width = std::max(a_end - i, b_end - j);
    const std::string a_run = std::string(width - (a_end - i), '0') + a.substr(i, a_end - i);
    const std::string b_run = std::string(width - (b_end - j), '0') + b.substr(j, b_end - j);
    if (a_run != b_run) return a_run < b_run;
    i = a_end;
    j = b_end;
  }
  if (a.size() - i != b.size() - j) return a.size() - i < b.size() - j;
  return a < b;
}

}  // namespace

std::vector<std::string> ListImageFiles(const std::string& folder) {
  std::vector<std::string> paths;
  std::error_code failure;
  for (const std::filesystem::directory_entry& entry : std::filesystem::directory_iterator(folder, failure)) {
    if (HasImageExtension(entry.path().string())) paths.push_back(entry.path().string());
  }
  std::sort(paths.begin(), paths.end(), NaturalLess);
  return paths;
}

bool HasImageExtension(const std::string& path) {
  std::string extension = std::filesystem::path(path).extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return std::tolower(c); });
  constexpr std::array<const char*, 8> kKnown{".jpg", ".jpeg", ".png", ".pgm", ".ppm", ".bmp", ".tif", ".tiff"};
  return std::find(kKnown.begin(), kKnown.end(), extension) != kKnown.end();
}

Result<cv::Mat> ReadGreyImage(const std::string& path) {
  Result<std::string> bytes = ReadTextFile(path);
  if (!bytes) return bytes.error();
  if (bytes->empty()) return Error{path + ": the image file is empty"};
  if (IsCutShort(*bytes)) return Error{path + ": the image file is cut short (its end marker is missing)"};
  Result<cv::Mat> grey = DecodeGrey(reinterpret_cast<const uint8_t*>(bytes->data()), bytes->size());
  if (!grey) return Error{path + ": " + grey.error().message};
  return grey;
}

}  // namespace portolan
