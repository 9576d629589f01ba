#include "process/frontend_process.h"
#include "process/process_start.h"
#include "process/topic_source.h"

int main(int argc, char** argv) {
  using namespace portolan;
  FrontendOptions options;
  const ProcessSetup setup = ProcessSetup::Make(
      "frontend_tracker", "Portolan's tracker: estimates the camera's pose in each frame and chooses keyframes", argc,
      argv,
      [](CLI::App* app, std::vector<std::string>* assignments) {
        const auto flag_for = [&](const char* flag, const char* key, const char* help) {
          app->add_option_function<std::string>(
              flag,
              [assignments, key](const std::string& value) { assignments->push_back(std::string(key) + "=" + value); },
              help);
        };
        flag_for("--data", "source.data",
                 "folder of a data set, video file, /dev/videoN, or 'topic' for the DDS image topic");
        flag_for("--camera", "source.camera", "calibration file (default: found in the data set)");
        flag_for("--speed", "source.speed", "factor of real time, max, or lockstep (default 1)");
        app->add_flag_callback(
            "--resume", [assignments] { assignments->emplace_back("source.resume=true"); },
            "go on with the run in --out if its frontend died: where the clock is, with what was tracked");
      },
      [&](ConfigReader* config) { return ReadFrontendOptions(config, &options); });
  if (setup.exit_code) return *setup.exit_code;

  const ProcessStart start = ProcessStart::Make(setup);
  if (start.exit_code) return *start.exit_code;
  auto source = OpenFrontendSource(options, start.bus.get());
  if (!source) {
    spdlog::error("{}", source.error().message);
    return kExitBadInput;
  }
  auto so_far = RunSoFar::Open(setup.options.out, options);
  if (!so_far) {
    spdlog::error("{}", so_far.error().message);
    return kExitBadInput;
  }
  PlaybackOptions playback = options.playback;
  playback.go_on = so_far->GoOn(options.source.first_frame);
  FrontendProcess process(setup, options, std::make_unique<Player>(std::move(*source), playback), std::move(*so_far),
                          start.vocabulary, start.bus.get(), start.priority, start.loop.get());
  return process.Run();
}
