#pragma once

#include <string>

#include "base/config_reader.h"
#include "dataset/image_source.h"
#include "dataset/player.h"
#include "tracking/tracker_options.h"

namespace portolan {

/// How long the image topic is waited for; 0: for ever.
struct TopicPatience {
  double first_image_s = 60;  ///< a publisher may be started by hand
  double pause_s = 5;         ///< a stream that pauses longer has ended
};

/// What the tracker's process is configured with.
struct FrontendOptions {
  SourceOptions source;      ///< section source
  TopicPatience topic;       ///< source.first_image_s, source.pause_s
  std::string speed = "1";   ///< source.speed: a factor of real time, "max" or "lockstep"
  PlaybackOptions playback;  ///< from speed
  TrackerOptions tracker;    ///< sections tracker and orb
  bool resume = false;       ///< source.resume: go on with the run in OUT, if its frontend died
  /// How long the run waits for mapper and atlas_server at its start, and for the mapper to finish at its end.
  double peer_timeout_s = 15;
};

/// The value of source.data that stands for the DDS image topic instead of a file.
constexpr const char* kTopicSource = "topic";

/// Reads and checks the sections source, tracker and orb.
Status ReadFrontendOptions(ConfigReader* config, FrontendOptions* options);

}  // namespace portolan
