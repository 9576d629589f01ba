#include "tracking/place_queries.h"

#include <gtest/gtest.h>

namespace portolan {
namespace {

Timestamp At(double seconds) {
  return Timestamp::FromSeconds(seconds);
}

TEST(PlaceQueries, AsksOnceASecond) {
  PlaceQueries queries;
  EXPECT_TRUE(queries.IsDue(At(5)));
  queries.NoteSent(At(5));
  EXPECT_FALSE(queries.IsDue(At(5.9)));
  EXPECT_TRUE(queries.IsDue(At(6)));
}

TEST(PlaceQueries, AMapBeginsAtOnceWhereTheAtlasIsEmpty) {
  PlaceQueries queries;
  EXPECT_TRUE(queries.MayBegin(At(0)));
}

TEST(PlaceQueries, WaitsForThreeDenials) {
  PlaceQueries queries;
  queries.NoteMapsInAtlas(2);
  EXPECT_FALSE(queries.MayBegin(At(0)));
  for (int i = 0; i < 3; ++i) {
    EXPECT_FALSE(queries.MayBegin(At(i)));
    queries.NoteSent(At(i));
    queries.OnReply(false);
  }
  EXPECT_TRUE(queries.MayBegin(At(3)));
}

TEST(PlaceQueries, AFindingIsNoDenial) {
  PlaceQueries queries;
  queries.NoteMapsInAtlas(1);
  for (int i = 0; i < 5; ++i) {
    queries.NoteSent(At(i));
    queries.OnReply(true);
  }
  EXPECT_FALSE(queries.MayBegin(At(5)));
}

TEST(PlaceQueries, DoesNotWaitForAnAtlasThatIsSilent) {
  PlaceQueries queries;
  queries.NoteMapsInAtlas(1);
  queries.NoteSent(At(1));
  queries.NoteSent(At(2));
  EXPECT_FALSE(queries.MayBegin(At(2.9)));
  EXPECT_TRUE(queries.MayBegin(At(3.1)));
  queries.OnReply(false);  // it answers after all
  EXPECT_FALSE(queries.MayBegin(At(3.2)));
}

}  // namespace
}  // namespace portolan
