#include <dds/dds.h>

#include <cstdlib>
#include <map>

#include "transport/cyclonedds_config.h"
#include "transport/cyclonedds_domain.h"
#include "transport/cyclonedds_qos.h"
#include "transport/cyclonedds_reader.h"
#include "transport/cyclonedds_sertype.h"
#include "transport/cyclonedds_writer.h"
#include "transport/raw_bus.h"
#include "transport/vendor_log.h"

namespace portolan {
namespace {

/// A publisher and a subscriber within a partition, or in none.
struct Group {
  dds_entity_t publisher = 0;
  dds_entity_t subscriber = 0;
};

struct MadeTopic {
  dds_entity_t topic = 0;
  const ddsi_sertype* type = nullptr;  // owned by the topic
};

class CycloneDdsBus final : public RawBus {
 public:
  ~CycloneDdsBus() override {
    if (participant_ > 0) dds_delete(participant_);
  }

  Status Join(const BusOptions& options, const BusSurroundings& surroundings) {
    TakeCycloneDdsLog();
    const char* user_uri = std::getenv("CYCLONEDDS_URI");
    const Status joined = domain_.Join(
        options.domain, CycloneDdsConfig(options, surroundings.peers, user_uri == nullptr ? "" : user_uri));
    if (!joined.ok()) return joined;
    const Result<CycloneDdsQos> qos = MakeCycloneDdsParticipantQos(surroundings.credentials);
    if (!qos.ok()) return qos.error();
    participant_ = dds_create_participant(static_cast<dds_domainid_t>(options.domain), qos->get(), nullptr);
    if (participant_ < 0) {
      return Error{"Cyclone DDS made no participant in domain " + std::to_string(options.domain) + ": " +
                   dds_strretcode(participant_)};
    }
    return MakeGroup("", &everyone_) && MakeGroup(options.partition, &robot_)
               ? Status(Ok{})
               : Status(Error{"Cyclone DDS made no publisher or subscriber"});
  }

  Result<std::unique_ptr<RawWriter>> CreateWriter(const RawTopic& topic) override {
    const Result<MadeTopic> made = FindOrMakeTopic(topic);
    if (!made.ok()) return made.error();
    return CycloneDdsWriter::Create(GroupOf(topic).publisher, made->topic, made->type, topic);
  }

  Result<std::unique_ptr<Reader>> CreateReader(const RawTopic& topic, RawReaderEvents events) override {
    const Result<MadeTopic> made = FindOrMakeTopic(topic);
    if (!made.ok()) return made.error();
    return CycloneDdsReader::Create(participant_, GroupOf(topic).subscriber, made->topic, topic, std::move(events));
  }

 private:
  bool MakeGroup(const std::string& partition, Group* group) {
    const CycloneDdsQos qos = MakeCycloneDdsGroupQos(partition);
    group->publisher = dds_create_publisher(participant_, qos.get(), nullptr);
    group->subscriber = dds_create_subscriber(participant_, qos.get(), nullptr);
    return group->publisher > 0 && group->subscriber > 0;
  }

  const Group& GroupOf(const RawTopic& topic) const { return topic.qos.in_partition ? robot_ : everyone_; }

  Result<MadeTopic> FindOrMakeTopic(const RawTopic& topic) {
    const auto found = topics_.find(topic.name);
    if (found != topics_.end()) return found->second;
    ddsi_sertype* type = MakeCycloneDdsType(topic.type, topic.keyed);
    const dds_entity_t made =
        dds_create_topic_sertype(participant_, topic.name.c_str(), &type, nullptr, nullptr, nullptr);
    if (made < 0) {
      ddsi_sertype_unref(type);
      return Error{"Cyclone DDS made no topic " + topic.name + ": " + dds_strretcode(made)};
    }
    return topics_[topic.name] = MadeTopic{made, type};
  }

  CycloneDdsDomain domain_;  // left last, after the participant
  dds_entity_t participant_ = 0;
  Group everyone_;
  Group robot_;
  std::map<std::string, MadeTopic> topics_;
};

}  // namespace

Result<std::unique_ptr<RawBus>> MakeCycloneDdsBus(const BusOptions& options, const BusSurroundings& surroundings) {
  auto bus = std::make_unique<CycloneDdsBus>();
  const Status joined = bus->Join(options, surroundings);
  if (!joined.ok()) return joined.error();
  return std::unique_ptr<RawBus>(std::move(bus));
}

}  // namespace portolan
