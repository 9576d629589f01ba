#include "dataset/image_list.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <filesystem>
#include <functional>
#include <optional>

#include "base/check.h"
#include "dataset/image_file.h"
#include "dataset/text_table.h"

namespace portolan {
namespace {

namespace fs = std::filesystem;
using ImageList = std::vector<ListedImage>;
/// The image that a row names; none if the row does not have the form. @param index number of the row, from 0.
using RowParser = std::function<std::optional<ListedImage>(const std::vector<std::string>& fields, size_t index)>;

/// Reads a list row by row; refuses a row that `parse` does not understand and times that do not rise.
Result<ImageList> ReadRows(const std::string& file, const std::string& expected, const RowParser& parse) {
  Result<std::vector<TextRow>> rows = ReadTextTable(file);
  if (!rows) return rows.error();
  ImageList images;
  for (const TextRow& row : *rows) {
    const std::optional<ListedImage> image = parse(row.fields, images.size());
    if (!image) {
      return Error{fmt::format("{}:{}: expected {}, found '{}'", file, row.line, expected, fmt::join(row.fields, " "))};
    }
    if (!images.empty() && image->stamp <= images.back().stamp) {
      return Error{fmt::format("{}:{}: times must rise, but {} s follows {} s", file, row.line,
                               FormatSeconds(image->stamp), FormatSeconds(images.back().stamp))};
    }
    images.push_back(*image);
  }
  return images;
}

std::optional<ListedImage> MakeImage(std::optional<Timestamp> stamp, const std::string& path) {
  return stamp ? std::optional<ListedImage>({*stamp, path}) : std::nullopt;
}

Error CountsDiffer(const std::string& times, size_t num_times, size_t num_images, const std::string& folder) {
  return Error{fmt::format("{}: has {} times for {} images in {}", times, num_times, num_images, folder)};
}

Result<ImageList> ReadKittiList(const std::string& data) {
  const std::string folder = fmt::format("{}/image_{}", data, FindKittiCamera(data).value_or(0));
  const std::vector<std::string> present = ListImageFiles(folder);
  if (present.empty()) return Error{folder + ": expected images 000000.png or .jpg, found none"};
  const std::string extension = fs::path(present[0]).extension().string();
  Result<ImageList> images =
      ReadRows(data + "/times.txt", "one time in seconds", [&](const std::vector<std::string>& fields, size_t index) {
        const auto stamp = fields.size() == 1 ? ParseSeconds(fields[0]) : std::nullopt;
        return MakeImage(stamp, fmt::format("{}/{:06}{}", folder, index, extension));
      });
  if (images && present.size() > images->size()) {
    return CountsDiffer(data + "/times.txt", images->size(), present.size(), folder);
  }
  return images;
}

Result<ImageList> ReadTumList(const std::string& data) {
  return ReadRows(data + "/rgb.txt", "'seconds file'", [&](const std::vector<std::string>& fields, size_t) {
    if (fields.size() != 2) return MakeImage(std::nullopt, "");
    return MakeImage(ParseSeconds(fields[0]), (fs::path(data) / fields[1]).string());
  });
}

Result<ImageList> ReadEurocList(const std::string& data) {
  const std::string camera = FindEurocCamera(data);
  return ReadRows(camera + "/data.csv", "'nanoseconds,file'", [&](const std::vector<std::string>& fields, size_t) {
    if (fields.size() != 2) return MakeImage(std::nullopt, "");
    return MakeImage(ParseNanoseconds(fields[0]), camera + "/data/" + fields[1]);
  });
}

/// times.txt of a plain folder: "name seconds", "seconds name", or seconds alone, which go to the images by order.
Result<ImageList> ReadPlainTimes(const std::string& data, const std::string& times,
                                 const std::vector<std::string>& present) {
  bool by_order = false;
  Result<ImageList> images =
      ReadRows(times, "'seconds', 'name seconds' or 'seconds name', the same in every line",
               [&](const std::vector<std::string>& fields, size_t index) {
                 if (index == 0) by_order = fields.size() == 1;
                 if (by_order != (fields.size() == 1) || fields.size() > 2) return MakeImage(std::nullopt, "");
                 if (by_order)
                   return MakeImage(ParseSeconds(fields[0]), index < present.size() ? present[index] : std::string());
                 const size_t name = HasImageExtension(fields[0]) ? 0 : 1;
                 if (!HasImageExtension(fields[name])) return MakeImage(std::nullopt, "");
                 return MakeImage(ParseSeconds(fields[1 - name]), (fs::path(data) / fields[name]).string());
               });
  if (images && by_order && images->size() != present.size())
    return CountsDiffer(times, images->size(), present.size(), data);
  return images;
}

Result<ImageList> ReadPlainList(const std::string& data, double fps) {
  const std::vector<std::string> present = ListImageFiles(data);
  const std::string times = data + "/times.txt";
  if (fs::exists(times)) return ReadPlainTimes(data, times, present);
  if (!(fps > 0)) return Error{fmt::format("{}: images without times.txt need a frame rate, found {}", data, fps)};
  ImageList images;
  for (const std::string& path : present) {
    images.push_back({Timestamp::FromSeconds(static_cast<double>(images.size()) / fps), path});
  }
  return images;
}

Result<ImageList> ReadUnchecked(const std::string& data, DatasetLayout layout, double fps) {
  if (layout == DatasetLayout::kKitti) return ReadKittiList(data);
  if (layout == DatasetLayout::kTum) return ReadTumList(data);
  if (layout == DatasetLayout::kEuroc) return ReadEurocList(data);
  PORTOLAN_CHECK(layout == DatasetLayout::kPlain) << "not a layout of folders: " << static_cast<int>(layout);
  return ReadPlainList(data, fps);
}

}  // namespace

std::optional<int> FindKittiCamera(const std::string& data) {
  constexpr int kNumCameras = 4;
  for (int camera = 0; camera < kNumCameras; ++camera) {
    if (fs::is_directory(fmt::format("{}/image_{}", data, camera))) return camera;
  }
  return std::nullopt;
}

std::string FindEurocCamera(const std::string& data) {
  for (const char* below : {"/mav0/cam0", "/cam0", ""}) {
    if (fs::exists(data + below + "/data.csv")) return data + below;
  }
  return "";
}

Result<std::vector<ListedImage>> ReadImageList(const std::string& data, DatasetLayout layout, double fps) {
  Result<ImageList> images = ReadUnchecked(data, layout, fps);
  if (!images) return images;
  if (images->empty()) return Error{data + ": the data set lists no image"};
  std::vector<std::string> missing;
  for (const ListedImage& image : *images) {
    if (!fs::is_regular_file(image.path)) missing.push_back(image.path);
  }
  if (missing.size() == images->size()) {
    return Error{
        fmt::format("{}: none of the {} listed images exists; the first is {}", data, images->size(), missing[0])};
  }
  if (!missing.empty()) {
    spdlog::warn("{}: {} of {} listed images are missing; the first is {}", data, missing.size(), images->size(),
                 missing[0]);
  }
  return images;
}

}  // namespace portolan
