#pragma once

#include <fastdds/dds/domain/qos/DomainParticipantQos.hpp>
#include <fastdds/dds/publisher/qos/DataWriterQos.hpp>
#include <fastdds/dds/subscriber/qos/DataReaderQos.hpp>

#include "transport/raw_bus.h"
#include "transport/topic_qos.h"

namespace portolan {

// Settings of Fast DDS without which it crawls or loses (design/dds.md); each is explained where it is set.

eprosima::fastdds::dds::DomainParticipantQos FastDdsParticipantQos(const BusOptions& options,
                                                                   const BusSurroundings& surroundings);
eprosima::fastdds::dds::DataWriterQos FastDdsWriterQos(const TopicQos& qos);
eprosima::fastdds::dds::DataReaderQos FastDdsReaderQos(const TopicQos& qos);
eprosima::fastrtps::Duration_t FastDdsDuration(double seconds);

}  // namespace portolan
