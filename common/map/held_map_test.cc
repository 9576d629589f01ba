#include "map/held_map.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "map/random_edits.h"

namespace portolan {
namespace {

TEST(HeldMap, IsTheSameAfterItsWayThroughText) {
  Map map(MapId(0, 1, 1), 7);
  RandomEdits edits(1, &map);
  for (int i = 0; i < 50; ++i) edits.Next();
  static_cast<void>(map.TakeDelta());
  const HeldMap held = MeasureMap(map);
  EXPECT_GT(held.keyframes, 0u);
  const Result<HeldMap> back = ParseHeldMap(map.id(), ToText(held));
  ASSERT_TRUE(back.ok()) << back.error().message;
  EXPECT_EQ(back->epoch, 7u);
  EXPECT_EQ(back->revision, map.revision());
  EXPECT_TRUE(HasSameContent(*back, held));
}

TEST(HeldMap, OwnerAndRevisionAreNoContentAndAllElseIs) {
  const HeldMap held{MapId(0, 1, 1), 1, 2, 3, 4, 5};
  HeldMap other = held;
  other.epoch = 9;
  other.revision = 10;
  EXPECT_TRUE(HasSameContent(held, other));
  for (const HeldMap& differs : {HeldMap{MapId(0, 1, 2), 1, 2, 3, 4, 5}, HeldMap{held.map, 1, 2, 2, 4, 5},
                                 HeldMap{held.map, 1, 2, 3, 3, 5}, HeldMap{held.map, 1, 2, 3, 4, 6}}) {
    EXPECT_FALSE(HasSameContent(held, differs)) << ToText(differs);
  }
}

TEST(HeldMap, RefusesATextThatTellsSomethingElse) {
  const std::string whole = ToText({MapId(0, 1, 1), 1, 2, 3, 4, 5});
  for (const std::string& text : {std::string(), std::string("standby"), whole + " ", whole.substr(0, 20)}) {
    const Result<HeldMap> held = ParseHeldMap(MapId(0, 1, 1), text);
    ASSERT_FALSE(held.ok()) << text;
    EXPECT_THAT(held.error().message, ::testing::HasSubstr("0.000001.1"));
  }
}

}  // namespace
}  // namespace portolan
