#include <fastrtps/xmlparser/XMLProfileManager.h>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/log/Log.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/Topic.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>
#include <map>

#include "transport/fastdds_qos.h"
#include "transport/fastdds_reader.h"
#include "transport/fastdds_sample.h"
#include "transport/fastdds_writer.h"
#include "transport/raw_bus.h"
#include "transport/vendor_log.h"

namespace portolan {
namespace {

namespace dds = eprosima::fastdds::dds;

/// A publisher and a subscriber within a partition, or in none.
struct Group {
  dds::Publisher* publisher = nullptr;
  dds::Subscriber* subscriber = nullptr;
};

class FastDdsBus final : public RawBus {
 public:
  ~FastDdsBus() override {
    if (participant_ != nullptr) {
      participant_->delete_contained_entities();
      dds::DomainParticipantFactory::get_instance()->delete_participant(participant_);
    }
    dds::Log::Flush();  // it has a thread of its own, which the process's end would cut short
  }

  Status Join(const BusOptions& options, const BusSurroundings& surroundings) {
    TakeFastDdsLog();
    // Two buses in one process (tests) talk through the wire like any others; a process has one otherwise.
    eprosima::fastrtps::LibrarySettingsAttributes settings;
    settings.intraprocess_delivery = eprosima::fastrtps::INTRAPROCESS_OFF;
    eprosima::fastrtps::xmlparser::XMLProfileManager::library_settings(settings);

    participant_ = dds::DomainParticipantFactory::get_instance()->create_participant(
        static_cast<dds::DomainId_t>(options.domain), FastDdsParticipantQos(options, surroundings));
    if (participant_ == nullptr) {
      return Error{"Fast DDS made no participant in domain " + std::to_string(options.domain) + " (the log says why)"};
    }
    return MakeGroup("", &everyone_) && MakeGroup(options.partition, &robot_)
               ? Status(Ok{})
               : Status(Error{"Fast DDS made no publisher or subscriber (the log says why)"});
  }

  Result<std::unique_ptr<RawWriter>> CreateWriter(const RawTopic& topic) override {
    Result<dds::Topic*> made = FindOrMakeTopic(topic);
    if (!made.ok()) return made.error();
    return FastDdsWriter::Create(GroupOf(topic).publisher, *made, topic.qos);
  }

  Result<std::unique_ptr<Reader>> CreateReader(const RawTopic& topic, RawReaderEvents events) override {
    Result<dds::Topic*> made = FindOrMakeTopic(topic);
    if (!made.ok()) return made.error();
    return FastDdsReader::Create(GroupOf(topic).subscriber, *made, topic.qos, std::move(events));
  }

 private:
  bool MakeGroup(const std::string& partition, Group* group) {
    dds::PublisherQos publisher_qos;
    dds::SubscriberQos subscriber_qos;
    if (!partition.empty()) {
      publisher_qos.partition().push_back(partition.c_str());
      subscriber_qos.partition().push_back(partition.c_str());
    }
    group->publisher = participant_->create_publisher(publisher_qos);
    group->subscriber = participant_->create_subscriber(subscriber_qos);
    return group->publisher != nullptr && group->subscriber != nullptr;
  }

  const Group& GroupOf(const RawTopic& topic) const { return topic.qos.in_partition ? robot_ : everyone_; }

  Result<dds::Topic*> FindOrMakeTopic(const RawTopic& topic) {
    dds::Topic*& made = topics_[topic.name];
    if (made != nullptr) return made;
    dds::TypeSupport(new FastDdsSampleType(topic.type, topic.keyed)).register_type(participant_);
    made = participant_->create_topic(topic.name, topic.type, dds::TOPIC_QOS_DEFAULT);
    if (made == nullptr) return Error{"Fast DDS made no topic " + topic.name + " (the log says why)"};
    return made;
  }

  dds::DomainParticipant* participant_ = nullptr;
  Group everyone_;
  Group robot_;
  std::map<std::string, dds::Topic*> topics_;
};

}  // namespace

Result<std::unique_ptr<RawBus>> MakeFastDdsBus(const BusOptions& options, const BusSurroundings& surroundings) {
  auto bus = std::make_unique<FastDdsBus>();
  const Status joined = bus->Join(options, surroundings);
  if (!joined.ok()) return joined.error();
  return std::unique_ptr<RawBus>(std::move(bus));
}

}  // namespace portolan

#if defined(__SANITIZE_ADDRESS__)
/// Read by the address sanitizer at the start, beside ASAN_OPTIONS. Fast DDS 2.9.1 deletes its StatisticsWriterImpl
/// through a base of another size.
extern "C" const char* __asan_default_options() {
  return "new_delete_type_mismatch=0";
}
#endif
