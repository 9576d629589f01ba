#include "map/map_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <sstream>

#include "dataset/temp_folder.h"
#include "map/random_edits.h"

namespace portolan {
namespace {

using ::testing::HasSubstr;
namespace fs = std::filesystem;

Map MakeRandomMap(uint32_t number) {
  Map map(MapId(0, 1, number), 2);
  RandomEdits edits(number, &map);
  for (int i = 0; i < 100; ++i) edits.Next();
  static_cast<void>(map.TakeDelta());
  return map;
}

class MapFileTest : public ::testing::Test {
 protected:
  static std::string ErrorOf(const std::string& path) {
    const auto maps = ReadMapFile(path);
    return maps.ok() ? "" : maps.error().message;
  }
  std::string Bytes() const {
    std::ostringstream bytes;
    bytes << std::ifstream(path_, std::ios::binary).rdbuf();
    return bytes.str();
  }
  std::string WriteBytes(const std::string& bytes) const {
    const std::string path = folder_.Path("spoiled.pmap");
    std::ofstream(path, std::ios::binary) << bytes;
    return path;
  }

  TempFolder folder_;
  const std::string path_ = folder_.Path("a.pmap");
};

TEST_F(MapFileTest, MapsComeBackAsTheyWere) {
  const Map first = MakeRandomMap(1), second = MakeRandomMap(2);
  ASSERT_TRUE(WriteMapFile(path_, {&first, &second}).ok());
  const auto stored = ReadMapFile(path_);
  ASSERT_TRUE(stored.ok()) << stored.error().message;
  ASSERT_EQ(stored->size(), 2u);
  const auto back = RestoreMap((*stored)[0], nullptr), other = RestoreMap((*stored)[1], nullptr);
  ASSERT_TRUE(back.ok() && other.ok());
  EXPECT_EQ(HashMap(*back), HashMap(first));
  EXPECT_EQ(back->revision(), first.revision());
  EXPECT_EQ(back->epoch(), first.epoch());
  EXPECT_EQ(HashMap(*other), HashMap(second));
}

TEST_F(MapFileTest, DataThatCantBeFoundIsAnErrorAndNoFile) {
  const Map map = MakeRandomMap(1);
  const Status written =
      WriteMapFile(path_, {&map}, [](const KeyFrame&) -> Result<KeyFrameData> { return Error{"gone"}; });
  ASSERT_FALSE(written.ok());
  EXPECT_EQ(written.error().message, "gone");
  EXPECT_FALSE(fs::exists(path_));
}

TEST_F(MapFileTest, NamesTheFileThatIsNone) {
  EXPECT_THAT(ErrorOf(folder_.Path("none")), HasSubstr("none': can't be read"));
  EXPECT_THAT(ErrorOf(folder_.Path("")), HasSubstr("can't be read"));
  EXPECT_THAT(ErrorOf(WriteBytes("")), HasSubstr("spoiled.pmap': no map file"));
  EXPECT_THAT(ErrorOf(WriteBytes(std::string(1000, 'x'))), HasSubstr("no map file"));
}

TEST_F(MapFileTest, EveryCutIsNoticed) {
  const Map map = MakeRandomMap(1);
  ASSERT_TRUE(WriteMapFile(path_, {&map}).ok());
  const std::string bytes = Bytes();
  for (size_t size = 0; size < bytes.size(); size += 1 + bytes.size() / 300) {
    EXPECT_NE(ErrorOf(WriteBytes(bytes.substr(0, size))), "") << size << " of " << bytes.size();
  }
  EXPECT_NE(ErrorOf(WriteBytes(bytes.substr(0, bytes.size() - 1))), "");
  EXPECT_NE(ErrorOf(WriteBytes(bytes + "x")), "");
}

TEST_F(MapFileTest, EveryChangedByteIsNoticed) {
  const Map map = MakeRandomMap(1);
  ASSERT_TRUE(WriteMapFile(path_, {&map}).ok());
  const std::string bytes = Bytes();
  for (size_t at = 0; at < bytes.size(); at += 1 + bytes.size() / 300) {
    std::string spoiled = bytes;
    spoiled[at] = static_cast<char>(spoiled[at] ^ 0x10);
    EXPECT_NE(ErrorOf(WriteBytes(spoiled)), "") << "byte " << at;
  }
}

TEST_F(MapFileTest, AMapWithoutOneOfItsKeyFramesIsRefused) {
  Map map = MakeRandomMap(1);
  ASSERT_TRUE(WriteMapFile(path_, {&map}).ok());
  const std::string bytes = Bytes();
  uint64_t first = 0;
  std::memcpy(&first, bytes.data(), sizeof first);
  EXPECT_THAT(ErrorOf(WriteBytes(bytes.substr(sizeof first + first))), HasSubstr("is missing"));
  EXPECT_THAT(ErrorOf(WriteBytes(bytes.substr(0, sizeof first + first) + bytes)), HasSubstr("there twice"));
}

}  // namespace
}  // namespace portolan
