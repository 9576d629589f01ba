#pragma once

#include <atomic>
#include <fastdds/dds/core/condition/GuardCondition.hpp>
#include <fastdds/dds/core/condition/WaitSet.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/Topic.hpp>
#include <memory>
#include <thread>

#include "transport/raw_bus.h"

namespace portolan {

/// A reader with a thread of its own, which sleeps in a WaitSet until there is something to do.
class FastDdsReader final : public Reader {
 public:
  static Result<std::unique_ptr<Reader>> Create(eprosima::fastdds::dds::Subscriber* subscriber,
                                                eprosima::fastdds::dds::Topic* topic, const TopicQos& qos,
                                                RawReaderEvents events);
  ~FastDdsReader() override;

  int MatchedWriters() const override;
  int AliveWriters() const override;

 private:
  FastDdsReader(eprosima::fastdds::dds::Subscriber* subscriber, bool has_lease, RawReaderEvents events)
      : subscriber_(subscriber), has_lease_(has_lease), events_(std::move(events)) {}
  void Run();
  void HandleStatuses();
  void TakeSamples();

  eprosima::fastdds::dds::Subscriber* const subscriber_;
  const bool has_lease_;
  const RawReaderEvents events_;
  eprosima::fastdds::dds::DataReader* reader_ = nullptr;
  eprosima::fastdds::dds::GuardCondition stop_;
  eprosima::fastdds::dds::WaitSet wait_set_;
  std::atomic<int> alive_writers_{0};
  SampleBytes sample_;  // of the thread: kept for its memory
  std::thread thread_;
};

}  // namespace portolan
