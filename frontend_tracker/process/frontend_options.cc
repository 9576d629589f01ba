#include "process/frontend_options.h"

#include "tracking/tracker_config.h"

namespace portolan {
namespace {

void ReadSource(ConfigReader* config, FrontendOptions* options) {
  config->Read("source.data", &options->source.data);
  config->Read("source.camera", &options->source.camera_file);
  config->Read("source.speed", &options->speed);
  config->Read("source.resume", &options->resume);
  config->Read("source.camera_fps", &options->source.camera_fps, {1, 1000});
  config->Read("source.first_image_s", &options->topic.first_image_s, {0, 1e6});
  config->Read("source.pause_s", &options->topic.pause_s, {0, 1e6});
  int64_t first = 0, most = 0;
  config->Read("source.first_frame", &first, {0, 1'000'000'000});
  config->Read("source.max_frames", &most, {0, 1'000'000'000});
  options->source.first_frame = static_cast<uint64_t>(first);
  options->source.max_frames = static_cast<uint64_t>(most);
}

}  // namespace

Status ReadFrontendOptions(ConfigReader* config, FrontendOptions* options) {
  ReadSource(config, options);
  config->Read("source.peer_timeout_s", &options->peer_timeout_s, {0.1, 3600});
  if (Status checked = ReadTrackerOptions(config, &options->tracker); !checked) return checked;
  if (options->source.data.empty())
    return Error{"no images: give --data with a folder, a video file, /dev/videoN or 'topic'"};
  const Result<PlaybackOptions> playback = ParseSpeed(options->speed);
  if (!playback) return playback.error();
  options->playback = *playback;
  if (options->source.data == kTopicSource && playback->mode != PlaybackMode::kRealTime)
    return Error{"speed '" + options->speed + "' with the image topic: its images come when they are published"};
  return Ok{};
}

}  // namespace portolan
