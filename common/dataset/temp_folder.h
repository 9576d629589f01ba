#pragma once

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <opencv2/imgcodecs.hpp>
#include <string>

#include "base/check.h"

namespace portolan {

/// A folder for one test, removed at its end.
class TempFolder {
 public:
  TempFolder() {
    std::string pattern = (std::filesystem::temp_directory_path() / "portolan_XXXXXX").string();
    PORTOLAN_CHECK(mkdtemp(pattern.data()) != nullptr);
    path_ = pattern;
  }
  ~TempFolder() { std::filesystem::remove_all(path_); }
  TempFolder(const TempFolder&) = delete;
  TempFolder& operator=(const TempFolder&) = delete;

  const std::string& path() const { return path_; }
  std::string Path(const std::string& name) const { return path_ + "/" + name; }

  /// Writes a file, with its folders. @return its path.
  std::string Write(const std::string& name, const std::string& content) const {
    std::filesystem::create_directories(std::filesystem::path(Path(name)).parent_path());
    std::ofstream(Path(name), std::ios::binary) << content;
    return Path(name);
  }

  /// Writes an image of one grey value, of the kind that the name ends in. @return its path.
  std::string WriteImage(const std::string& name, int grey, cv::Size size = {32, 24}) const {
    std::filesystem::create_directories(std::filesystem::path(Path(name)).parent_path());
    PORTOLAN_CHECK(cv::imwrite(Path(name), cv::Mat(size, CV_8UC1, cv::Scalar(grey))));
    return Path(name);
  }

  /// Cuts a file off after a share of its bytes.
  void CutShort(const std::string& name, double share) const {
    const auto size = std::filesystem::file_size(Path(name));
    std::filesystem::resize_file(Path(name), static_cast<uintmax_t>(share * static_cast<double>(size)));
  }

 private:
  std::string path_;
};

/// The folder of the shared sequences: $PORTOLAN_DATA, or shared/data beside the repository; empty if neither is there.
inline std::string SharedDataFolder() {
  if (const char* named = std::getenv("PORTOLAN_DATA")) return named;
  const std::filesystem::path source = std::filesystem::path(__FILE__).parent_path();
  const std::filesystem::path beside = (source / "../../../shared/data").lexically_normal();
  return std::filesystem::is_directory(beside) ? beside.string() : "";
}

/// A calibration file for the images of WriteImage().
inline constexpr char kSmallCamera[] =
    "model: pinhole\nwidth: 32\nheight: 24\nfx: 30\nfy: 30\ncx: 16\ncy: 12\nfps: 10\n";

}  // namespace portolan
