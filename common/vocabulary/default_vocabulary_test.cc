#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <opencv2/imgcodecs.hpp>

#include "features/orb_extractor.h"
#include "vocabulary/vocabulary.h"

namespace portolan {
namespace {

namespace fs = std::filesystem;

const fs::path kHere = fs::path(__FILE__).parent_path();

std::shared_ptr<const Vocabulary> DefaultVocabulary() {
  return Vocabulary::Open((kHere / "default.pvoc").string()).value();
}

/// The data sets' folder: $PORTOLAN_DATA, or shared/data beside the repository.
fs::path DataFolder() {
  const char* folder = std::getenv("PORTOLAN_DATA");
  return folder != nullptr ? fs::path(folder) : kHere / "../../../shared/data";
}

BowVector BagOf(const Vocabulary& vocabulary, const fs::path& file) {
  const cv::Mat grey = cv::imread(file.string(), cv::IMREAD_GRAYSCALE);
  PORTOLAN_CHECK(!grey.empty()) << file.string();
  CameraModel camera;
  camera.pinhole.width = grey.cols;
  camera.pinhole.height = grey.rows;
  BowVector bow;
  NodeFeatures nodes;
  vocabulary.Transform(OrbExtractor(OrbOptions()).Extract(grey, camera).descriptors, 3, &bow, &nodes);
  return bow;
}

TEST(DefaultVocabulary, IsOfTheSizeItsPageSays) {
  const auto vocabulary = DefaultVocabulary();
  EXPECT_EQ(vocabulary->branching(), 10);
  EXPECT_EQ(vocabulary->depth(), 5);
  EXPECT_GT(vocabulary->num_words(), 90000u);
  EXPECT_LT(fs::file_size(kHere / "default.pvoc"), 6u << 20);  // it is part of the repository
}

TEST(DefaultVocabulary, KnowsAPlaceAgain) {
  const fs::path frames = DataFolder() / "town_lap/image_0";
  if (!fs::exists(frames)) GTEST_SKIP() << "no data at " << frames << " (PORTOLAN_DATA names its folder)";
  const auto vocabulary = DefaultVocabulary();
  // The town's second lap passes frame 237's place at frame 1102 (neither was trained on).
  const BowVector again = BagOf(*vocabulary, frames / "001102.jpg");
  const double same_place = BowScore(again, BagOf(*vocabulary, frames / "000237.jpg"));
  for (const char* elsewhere : {"000027.jpg", "000307.jpg", "000507.jpg", "000707.jpg", "000907.jpg"}) {
    EXPECT_GT(same_place, 1.2 * BowScore(again, BagOf(*vocabulary, frames / elsewhere))) << elsewhere;
  }
}

}  // namespace
}  // namespace portolan
