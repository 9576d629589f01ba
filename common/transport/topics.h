#pragma once

#include "map/protocol.h"
#include "messages/command_messages.h"
#include "messages/correction_messages.h"
#include "messages/delta_messages.h"
#include "messages/image_messages.h"
#include "messages/keyframe_messages.h"
#include "messages/status_messages.h"
#include "transport/topic_access.h"
#include "transport/topic_qos.h"

// All topics of Portolan: name, type on the wire, key, who writes and reads, quality of service. Domain types are on
// the left: Topic<KeyFrameMessage>. A process that takes up another topic has to stand in its kAccess: where DDS
// Security is on, it gets no endpoint otherwise.

namespace portolan {

/// How long the tracker may be held up by a full writer: a fraction of its 33 ms frame.
constexpr int kPromptBlockingMs = 5;
/// How long others may be.
constexpr int kPatientBlockingMs = 100;
/// A process whose worker has not asserted its liveliness for so long counts as dead or hung; it asserts every 150 ms.
constexpr int kLivelinessLeaseMs = 500;
constexpr int kLivelinessAssertMs = 150;

constexpr TopicQos Reliable(int max_samples, int max_blocking_ms) {
  TopicQos qos;
  qos.keep_all = true;
  qos.max_samples = max_samples;
  qos.max_blocking_ms = max_blocking_ms;
  return qos;
}

constexpr TopicQos BestEffort(int depth) {
  TopicQos qos;
  qos.reliable = false;
  qos.depth = depth;
  qos.max_samples = depth;
  return qos;
}

template <class T>
struct Topic;

/// Written by the tracker, and by a map's owner to answer a SnapshotRequest; read by all. Acknowledged by the
/// application, with the MapDelta that contains it. Not keyed by id: an instance each would grow the tables of both
/// vendors for ever (Fast DDS bounds samples only together with instances, and never forgets a live one), and would
/// deliver keyframes that arrive together out of order.
template <>
struct Topic<KeyFrameMessage> {
  using Wire = wire::KeyFrame;
  static constexpr const char* kName = "keyframe";
  static constexpr const char* kType = "portolan::wire_v1::KeyFrame";
  static constexpr bool kKeyed = false;
  static constexpr TopicAccess kAccess = {kRoleTracker | kRoleMapper | kRoleAtlas,
                                          kRoleTracker | kRoleMapper | kRoleLoop | kRoleAtlas | kRoleTool};
  static constexpr TopicQos Qos() { return Reliable(256, kPromptBlockingMs); }  // 20 MB, at 2000 features each
};

/// Written by a map's owner, or the atlas_server in its place; read by everyone who holds a replica.
template <>
struct Topic<MapDeltaChunk> {
  using Wire = wire::MapDelta;
  static constexpr const char* kName = "map_delta";
  static constexpr const char* kType = "portolan::wire_v1::MapDelta";
  static constexpr bool kKeyed = false;
  static constexpr TopicAccess kAccess = {kRoleMapper | kRoleAtlas,
                                          kRoleTracker | kRoleMapper | kRoleLoop | kRoleAtlas | kRoleTool};
  static constexpr TopicQos Qos() { return Reliable(1024, kPatientBlockingMs); }  // a snapshot of 8 million elements
};

/// Written by whoever holds a replica and misses something; read by the map's owner, and by the atlas_server, which
/// answers for a dead one.
template <>
struct Topic<SnapshotRequest> {
  using Wire = wire::SnapshotRequest;
  static constexpr const char* kName = "map_request";
  static constexpr const char* kType = "portolan::wire_v1::SnapshotRequest";
  static constexpr bool kKeyed = false;
  static constexpr TopicAccess kAccess = {kRoleTracker | kRoleMapper | kRoleLoop | kRoleAtlas | kRoleTool,
                                          kRoleMapper | kRoleAtlas};
  static constexpr TopicQos Qos() { return Reliable(64, kPromptBlockingMs); }  // one a second from each process
};

/// Written by the loop_closer and the atlas_server; read by the map's owner.
template <>
struct Topic<MapCorrection> {
  using Wire = wire::MapCorrection;
  static constexpr const char* kName = "correction";
  static constexpr const char* kType = "portolan::wire_v1::MapCorrection";
  static constexpr bool kKeyed = false;
  static constexpr TopicAccess kAccess = {kRoleLoop | kRoleAtlas, kRoleMapper};
  static constexpr TopicQos Qos() { return Reliable(16, kPatientBlockingMs); }  // rare, each up to the size of the map
};

/// Written by the atlas_server alone; read by all but tools, by an atlas_server that stands by too. Late readers get
/// the last commands, in order: they tell who owns what.
template <>
struct Topic<Command> {
  using Wire = wire::Command;
  static constexpr const char* kName = "command";
  static constexpr const char* kType = "portolan::wire_v1::Command";
  static constexpr bool kKeyed = false;
  static constexpr TopicAccess kAccess = {kRoleAtlas, kRoleTracker | kRoleMapper | kRoleLoop | kRoleAtlas};
  static constexpr TopicQos Qos() {
    TopicQos qos = Reliable(256, kPatientBlockingMs);
    qos.keep_all = false;
    qos.depth = 256;
    qos.transient_local = true;
    return qos;
  }
};

/// Written by tracker, mapper, tools and operators, and by a loop_closer or atlas_server that stands by; read by the
/// atlas_server.
template <>
struct Topic<Request> {
  using Wire = wire::Request;
  static constexpr const char* kName = "request";
  static constexpr const char* kType = "portolan::wire_v1::Request";
  static constexpr bool kKeyed = false;
  static constexpr TopicAccess kAccess = {kRoleTracker | kRoleMapper | kRoleLoop | kRoleAtlas | kRoleTool, kRoleAtlas};
  static constexpr TopicQos Qos() { return Reliable(256, kPromptBlockingMs); }
};

/// Written by the atlas_server; read by whoever asked.
template <>
struct Topic<Reply> {
  using Wire = wire::Reply;
  static constexpr const char* kName = "reply";
  static constexpr const char* kType = "portolan::wire_v1::Reply";
  static constexpr bool kKeyed = false;
  static constexpr TopicAccess kAccess = {kRoleAtlas, kRoleTracker | kRoleMapper | kRoleAtlas | kRoleTool};
  static constexpr TopicQos Qos() { return Reliable(256, kPatientBlockingMs); }
};

/// Written by the tracker for each frame; read by the mapper and by whoever watches. Only the newest counts.
template <>
struct Topic<TrackerState> {
  using Wire = wire::TrackerState;
  static constexpr const char* kName = "tracker_state";
  static constexpr const char* kType = "portolan::wire_v1::TrackerState";
  static constexpr bool kKeyed = false;
  static constexpr TopicAccess kAccess = {kRoleTracker, kRoleMapper | kRoleLoop | kRoleTool};
  static constexpr TopicQos Qos() { return BestEffort(1); }
};

/// Written by the mapper when it changes; read by tracker, loop_closer and atlas_server. All of them count: each
/// acknowledges a keyframe or a correction.
template <>
struct Topic<MapperState> {
  using Wire = wire::MapperState;
  static constexpr const char* kName = "mapper_state";
  static constexpr const char* kType = "portolan::wire_v1::MapperState";
  static constexpr bool kKeyed = false;
  static constexpr TopicAccess kAccess = {kRoleMapper, kRoleTracker | kRoleMapper | kRoleLoop | kRoleAtlas};
  static constexpr TopicQos Qos() { return Reliable(1024, kPatientBlockingMs); }
};

/// Written by the loop_closer when it changes; read by the tracker of a lockstep run. All of them count: each answers
/// for a keyframe.
template <>
struct Topic<FollowerState> {
  using Wire = wire::FollowerState;
  static constexpr const char* kName = "follower_state";
  static constexpr const char* kType = "portolan::wire_v1::FollowerState";
  static constexpr bool kKeyed = false;
  static constexpr TopicAccess kAccess = {kRoleLoop | kRoleAtlas, kRoleTracker};
  static constexpr TopicQos Qos() { return Reliable(1024, kPatientBlockingMs); }
};

/// Written by every process about itself; read by tracker, loop_closer, atlas_server and tools. Keyed by process; its
/// liveliness is the process's.
template <>
struct Topic<ProcessStatus> {
  using Wire = wire::ProcessStatus;
  static constexpr const char* kName = "process_status";
  static constexpr const char* kType = "portolan::wire_v1::ProcessStatus";
  static constexpr bool kKeyed = true;
  static constexpr TopicAccess kAccess = {kRoleTracker | kRoleMapper | kRoleLoop | kRoleAtlas,
                                          kRoleTracker | kRoleLoop | kRoleAtlas | kRoleTool};
  static constexpr TopicQos Qos() {
    TopicQos qos;
    qos.transient_local = true;
    qos.max_samples = 256;  // processes of a deployment that a reader follows
    qos.max_blocking_ms = kPromptBlockingMs;
    qos.liveliness_lease_ms = kLivelinessLeaseMs;
    return qos;
  }
};

/// Written by a camera driver or portolan_play; read by the tracker. ROS 2's names: the topic's is
/// BusOptions::image_topic.
template <>
struct Topic<Image> {
  using Wire = sensor_msgs::msg::dds_::Image_;
  static constexpr const char* kType = "sensor_msgs::msg::dds_::Image_";
  static constexpr bool kKeyed = false;
  static constexpr TopicAccess kAccess = {kRoleCamera, kRoleTracker};
  static constexpr TopicQos Qos() {
    TopicQos qos = BestEffort(5);  // as ROS 2's sensor data profile
    qos.in_partition = false;
    return qos;
  }
};

/// The second way in for images, by the image topic's name with a suffix; who reads Image gets both.
template <>
struct Topic<CompressedImage> : Topic<Image> {
  using Wire = sensor_msgs::msg::dds_::CompressedImage_;
  static constexpr const char* kSuffix = "/compressed";
  static constexpr const char* kType = "sensor_msgs::msg::dds_::CompressedImage_";
};

/// All topics but the images, which have a name that is configured and a writer and reader of their own.
#define PORTOLAN_FOR_EACH_TOPIC(APPLY) \
  APPLY(KeyFrameMessage)               \
  APPLY(MapDeltaChunk)                 \
  APPLY(SnapshotRequest)               \
  APPLY(MapCorrection)                 \
  APPLY(Command)                       \
  APPLY(Request)                       \
  APPLY(Reply)                         \
  APPLY(TrackerState)                  \
  APPLY(MapperState)                   \
  APPLY(FollowerState)                 \
  APPLY(ProcessStatus)

}  // namespace portolan
