#include "base/bounded_queue.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <memory>
#include <thread>
#include <vector>

namespace portolan {
namespace {

TEST(BoundedQueueTest, GivesElementsInTheirOrder) {
  BoundedQueue<int> queue(3, Overflow::kDropOldest);
  for (int i = 1; i <= 3; ++i) EXPECT_TRUE(queue.Push(i));
  EXPECT_EQ(queue.size(), 3u);
  for (int i = 1; i <= 3; ++i) EXPECT_EQ(queue.Pop(), i);
  EXPECT_EQ(queue.TryPop(), std::nullopt);
}

TEST(BoundedQueueTest, DropsTheOldestAndCountsIt) {
  BoundedQueue<int> queue(2, Overflow::kDropOldest);
  queue.Push(1);
  queue.Push(2);
  EXPECT_FALSE(queue.Push(3));
  EXPECT_EQ(queue.dropped(), 1u);
  EXPECT_EQ(queue.Pop(), 2);
  EXPECT_EQ(queue.Pop(), 3);
}

TEST(BoundedQueueTest, DropsTheNewestAndCountsIt) {
  BoundedQueue<int> queue(2, Overflow::kDropNewest);
  queue.Push(1);
  queue.Push(2);
  EXPECT_FALSE(queue.Push(3));
  EXPECT_EQ(queue.dropped(), 1u);
  EXPECT_EQ(queue.Pop(), 1);
  EXPECT_EQ(queue.Pop(), 2);
}

TEST(BoundedQueueTest, RefusesElementsAfterCloseButGivesWhatItHas) {
  BoundedQueue<int> queue(2, Overflow::kDropOldest);
  queue.Push(1);
  queue.Close();
  EXPECT_TRUE(queue.closed());
  EXPECT_FALSE(queue.Push(2));
  EXPECT_EQ(queue.dropped(), 0u);
  EXPECT_EQ(queue.Pop(), 1);
  EXPECT_EQ(queue.Pop(), std::nullopt);
}

TEST(BoundedQueueTest, PopUntilReturnsNothingAfterItsDeadline) {
  BoundedQueue<int> queue(1, Overflow::kDropOldest);
  EXPECT_EQ(queue.PopUntil(std::chrono::steady_clock::now()), std::nullopt);
  queue.Push(7);
  EXPECT_EQ(queue.PopUntil(std::chrono::steady_clock::now()), 7);
}

TEST(BoundedQueueTest, CloseWakesAWaitingConsumer) {
  BoundedQueue<int> queue(1, Overflow::kDropOldest);
  std::optional<int> popped = 1;
  std::thread consumer([&] { popped = queue.Pop(); });
  queue.Close();
  consumer.join();
  EXPECT_EQ(popped, std::nullopt);
}

TEST(BoundedQueueTest, MovesElementsThatCannotBeCopied) {
  BoundedQueue<std::unique_ptr<int>> queue(1, Overflow::kDropNewest);
  queue.Push(std::make_unique<int>(5));
  const auto popped = queue.Pop();
  ASSERT_TRUE(popped.has_value());
  EXPECT_EQ(**popped, 5);
}

TEST(BoundedQueueTest, EveryElementOfManyThreadsIsDeliveredOrCountedOnce) {
  constexpr int kProducers = 3;
  constexpr int kEach = 2000;
  BoundedQueue<int> queue(16, Overflow::kDropOldest);
  std::vector<std::thread> producers;
  for (int p = 0; p < kProducers; ++p) {
    producers.emplace_back([&queue, p] {
      for (int i = 0; i < kEach; ++i) queue.Push(p * kEach + i);
    });
  }
  std::vector<int> last(kProducers, -1);
  uint64_t delivered = 0;
  std::thread consumer([&] {
    while (const auto element = queue.Pop()) {
      const int producer = *element / kEach;
      EXPECT_LT(last[producer], *element) << "elements of one producer keep their order";
      last[producer] = *element;
      ++delivered;
    }
  });
  for (std::thread& producer : producers) producer.join();
  queue.Close();
  consumer.join();
  EXPECT_EQ(delivered + queue.dropped(), uint64_t{kProducers * kEach});
}

}  // namespace
}  // namespace portolan
