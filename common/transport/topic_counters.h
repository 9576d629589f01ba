#pragma once

#include <atomic>
#include <map>
#include <memory>
#include <mutex>
#include <string>

#include "transport/bus.h"

namespace portolan {

/// TopicCounters that endpoints on several threads add to.
struct AtomicTopicCounters {
  std::atomic<uint64_t> sent{0}, sent_bytes{0}, received{0}, received_bytes{0}, malformed{0}, send_failures{0}, lost{0};
  TopicCounters Load() const;
};

/// Counters by topic name. Thread-safe; a topic's counters outlive the table where an endpoint still holds them.
class CounterTable {
 public:
  std::shared_ptr<AtomicTopicCounters> ForTopic(const std::string& name);
  std::map<std::string, TopicCounters> Load() const;

 private:
  mutable std::mutex mutex_;
  std::map<std::string, std::shared_ptr<AtomicTopicCounters>> topics_;
};

}  // namespace portolan
