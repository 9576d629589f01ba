#pragma once

#include <optional>
#include <string>
#include <vector>

#include "base/result.h"
#include "base/time.h"
#include "dataset/image_source.h"

namespace portolan {

/// One image that a data set names.
struct ListedImage {
  Timestamp stamp;
  std::string path;
};

/// The camera whose images a KITTI data set has: the first N of 0 to 3 with a folder image_N (grey left and right, then
/// colour left and right); none if there is no such folder.
std::optional<int> FindKittiCamera(const std::string& data);

/// The folder of the list of a EuRoC data set: data/mav0/cam0, data/cam0 or data itself, whichever has data.csv; else
/// empty.
std::string FindEurocCamera(const std::string& data);

/// Reads and checks the list of images of a folder data set. `fps` stamps the images of a plain folder without
/// times.txt, in the order of their names (numbers in names by value: 2.jpg before 10.jpg). Fails, naming file and
/// line: a line that does not parse, times that do not rise, as many images as times where they go by order, no image
/// at all, and when none of the listed files exists (the first is named). Some missing files are no failure: each is
/// one unreadable frame.
Result<std::vector<ListedImage>> ReadImageList(const std::string& data, DatasetLayout layout, double fps);

}  // namespace portolan
