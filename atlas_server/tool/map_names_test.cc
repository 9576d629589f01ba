#include "tool/map_names.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace portolan {
namespace {

using ::testing::HasSubstr;

TEST(ParseIdTest, IsTheInverseOfFormatId) {
  for (const MapId id : {MapId(0, 1, 1), MapId(65535, 0xffffff, 0xffffff), MapId(3, 0x3fa21c, 17), MapId()})
    EXPECT_EQ(ParseIdAs<MapId>(ToString(id)), id) << id;
}

TEST(ParseIdTest, RefusesWhatIsNoId) {
  for (const char* text : {"", ".", "..", "1", "0.1", "0.1.", ".1.1", "0..1", "0.1.1.1", "65536.1.1", "0.1000000.1",
                           "0.1.16777216", "-1.1.1", "0.g.1", "0.1.1 ", " 0.1.1", "0x0.1.1", "0.0x1.1", "map"})
    EXPECT_FALSE(ParseId(text).has_value()) << text;
}

class ChooseMapTest : public ::testing::Test {
 protected:
  std::string Chosen(const std::string& name, MapId last = MapId()) const {
    const Result<MapId> map = ChooseMap(name, maps_, last);
    return map ? ToString(*map) : map.error().message;
  }
  std::vector<MapId> maps_{MapId(0, 0xa1b2c3, 1), MapId(0, 0xa1b2c3, 11), MapId(2, 0xa1b2c3, 3), MapId(2, 0xd00000, 4)};
};

TEST_F(ChooseMapTest, TakesTheWholeName) {
  EXPECT_EQ(Chosen("0.a1b2c3.1"), "0.a1b2c3.1");
}

TEST_F(ChooseMapTest, TakesTheNumberBeforeAnEndOfTheName) {
  EXPECT_EQ(Chosen("1"), "0.a1b2c3.1");
  EXPECT_EQ(Chosen("11"), "0.a1b2c3.11");
}

TEST_F(ChooseMapTest, TakesAUniqueBeginningOrEnd) {
  EXPECT_EQ(Chosen("2.d"), "2.d00000.4");
  EXPECT_EQ(Chosen("3.3"), "2.a1b2c3.3");
  EXPECT_EQ(Chosen("0000.4"), "2.d00000.4");
}

TEST_F(ChooseMapTest, NamesTheCandidatesOfAnAmbiguousName) {
  const std::string message = Chosen("2.");
  EXPECT_THAT(message, HasSubstr("'2.' may be any of 2.a1b2c3.3, 2.d00000.4"));
  maps_.push_back(MapId(7, 1, 1));
  EXPECT_THAT(Chosen("1"), HasSubstr("may be any of"));
}

TEST_F(ChooseMapTest, NamesTheMapsThatThereAreForAnUnknownName) {
  EXPECT_THAT(Chosen("9"), HasSubstr("no map is called '9': there are 0.a1b2c3.1, "));
  EXPECT_THAT(Chosen("a1b2"), HasSubstr("no map is called")) << "in the middle is no beginning";
  EXPECT_THAT(Chosen(""), HasSubstr("empty"));
  maps_.clear();
  EXPECT_THAT(Chosen("1"), HasSubstr("no map"));
}

TEST_F(ChooseMapTest, LastIsTheOneThatChangedLast) {
  EXPECT_EQ(Chosen("last", maps_[2]), ToString(maps_[2]));
  EXPECT_THAT(Chosen("last"), HasSubstr("name one of"));
}

}  // namespace
}  // namespace portolan
