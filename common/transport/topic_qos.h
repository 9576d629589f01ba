#pragma once

namespace portolan {

/// Quality of service of a topic, the same for its writers and readers on both vendors.
struct TopicQos {
  bool reliable = true;
  bool keep_all = false;  ///< else the last `depth` of each instance
  int depth = 1;
  bool transient_local = false;  ///< a late reader gets what is kept
  /// Samples that an endpoint holds at most. When a keep-all writer is full, Write waits `max_blocking_ms` and fails; a
  /// keep-last writer forgets its oldest sample; a full reader refuses, and a reliable writer sends again. (Cyclone DDS
  /// bounds writers by bytes instead: its high-water mark, cyclonedds_config.h.)
  int max_samples = 1;  ///< of a keyed topic: with one sample each, so also its instances
  int max_blocking_ms = 0;
  /// Lease of MANUAL_BY_TOPIC liveliness; 0: none.
  int liveliness_lease_ms = 0;
  bool in_partition = true;  ///< the robot's; else none, as ROS 2
};

}  // namespace portolan
