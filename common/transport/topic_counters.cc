#include "transport/topic_counters.h"

namespace portolan {

TopicCounters AtomicTopicCounters::Load() const {
  TopicCounters counters;
  counters.sent = sent;
  counters.sent_bytes = sent_bytes;
  counters.received = received;
  counters.received_bytes = received_bytes;
  counters.malformed = malformed;
  counters.send_failures = send_failures;
  counters.lost = lost;
  return counters;
}

std::shared_ptr<AtomicTopicCounters> CounterTable::ForTopic(const std::string& name) {
  std::lock_guard<std::mutex> lock(mutex_);
  std::shared_ptr<AtomicTopicCounters>& counters = topics_[name];
  if (!counters) counters = std::make_shared<AtomicTopicCounters>();
  return counters;
}

std::map<std::string, TopicCounters> CounterTable::Load() const {
  std::lock_guard<std::mutex> lock(mutex_);
  std::map<std::string, TopicCounters> loaded;
  for (const auto& [name, counters] : topics_) loaded[name] = counters->Load();
  return loaded;
}

}  // namespace portolan
