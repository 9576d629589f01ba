#pragma once

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>
#include <vector>

namespace portolan {

/// What is wrong with a wire message, for tests of what FromWire refuses.
template <class Wire>
struct Malformed {
  const char* reason;  ///< is part of the refusal
  std::function<void(Wire*)> spoil;
};

/// The message is good, and none of its spoilt copies is.
template <class Wire>
void ExpectRefused(const Wire& good, const std::vector<Malformed<Wire>>& cases) {
  ASSERT_TRUE(FromWire(good).ok()) << FromWire(good).error().message;
  for (const Malformed<Wire>& malformed : cases) {
    Wire spoilt = good;
    malformed.spoil(&spoilt);
    const auto result = FromWire(spoilt);
    ASSERT_FALSE(result.ok()) << malformed.reason;
    EXPECT_THAT(result.error().message, ::testing::HasSubstr(malformed.reason));
  }
}

}  // namespace portolan
