// portolan_synth: renders a synthetic place along a camera's way to a data set with exact ground truth.

#include <unistd.h>

#include <CLI/CLI.hpp>
#include <csignal>
#include <cstdio>
#include <map>
#include <opencv2/core.hpp>
#include <string>
#include <utility>
#include <vector>

#include "base/command_line.h"
#include "base/time.h"
#include "testing/sequence_writer.h"
#include "version/version.h"

namespace portolan {
namespace {

constexpr int kExitFailure = 1;  // could not be written

volatile std::sig_atomic_t interrupted = 0;

struct Arguments {
  SequenceOptions sequence;
  SequenceWriterOptions writer;
  std::string size = "640x480", layout = "tum", format = "jpg";
  std::pair<double, double> lens{0, 0};
  bool quiet = false;
};

const std::map<std::string, SequenceLayout>& Layouts() {
  static const std::map<std::string, SequenceLayout> layouts = {
      {"tum", SequenceLayout::kTum}, {"kitti", SequenceLayout::kKitti}, {"euroc", SequenceLayout::kEuroc}};
  return layouts;
}

const std::map<std::string, PictureFormat>& Formats() {
  static const std::map<std::string, PictureFormat> formats = {{"jpg", PictureFormat::kJpeg},
                                                               {"png", PictureFormat::kPng}};
  return formats;
}

template <class T>
std::vector<std::string> Keys(const std::map<std::string, T>& map) {
  std::vector<std::string> keys;
  for (const auto& [key, value] : map) keys.push_back(key);
  return keys;
}

void AddOptions(CLI::App* app, Arguments* arguments) {
  SequenceOptions& sequence = arguments->sequence;
  std::string scenes = "what to film:";
  for (const SceneDescription& scene : SceneNames()) scenes += "\n" + scene.name + ": " + scene.text;
  app->add_option("scene", sequence.scene, scenes)->required();
  app->add_option("--out", arguments->writer.folder, "folder of the data set")->required();
  app->add_option("--layout", arguments->layout, "of the folder")
      ->check(CLI::IsMember(Keys(Layouts())))
      ->capture_default_str();
  app->add_option("--format", arguments->format, "of the pictures; jpg has quality 95")
      ->check(CLI::IsMember(Keys(Formats())))
      ->capture_default_str();
  app->add_flag("--force", arguments->writer.overwrite, "write into the folder even if it is not empty");
  app->add_option("--frames", sequence.num_frames, "number of frames at most; 0 films the whole way")
      ->capture_default_str();
  app->add_option("--fps", sequence.fps, "frames a second")->capture_default_str();
  app->add_option("--size", arguments->size, "width x height in pixels")->capture_default_str();
  app->add_option("--seed", sequence.seed, "of the place and the noise; same seed, same bytes")->capture_default_str();
  app->add_option("--speed", sequence.speed, "factor on the camera's speed")->capture_default_str();
  app->add_option("--texture", sequence.texture_px, "pixels along the larger textures, a power of two")
      ->capture_default_str();
  app->add_flag("--repeat-facades", sequence.repeat_facades, "town, street: houses that look alike");
  app->add_option("--lens", arguments->lens,
                  "k1 k2: radial distortion of the lens, of which the camera file does not tell");
  app->add_option("--noise", sequence.sensor.noise_sigma, "sigma of the sensor's noise, grey levels")
      ->capture_default_str();
  app->add_option("--exposure-change", sequence.sensor.exposure_change,
                  "slow change of brightness: 0.2 goes from 0.8 to 1.2")
      ->capture_default_str();
  app->add_option("--shutter", sequence.sensor.exposure_s, "seconds the shutter is open: motion blur")
      ->capture_default_str();
  app->add_flag("--quiet", arguments->quiet, "no progress");
}

bool ParseSize(const std::string& text, SequenceOptions* options) {
  int used = 0;
  return std::sscanf(text.c_str(), "%dx%d%n", &options->width, &options->height, &used) == 2 &&
         used == static_cast<int>(text.size());
}

/// One line on a terminal, a line at each tenth elsewhere.
bool ShowProgress(size_t done, size_t all, const Stopwatch& watch) {
  const bool terminal = isatty(STDERR_FILENO) != 0;
  const bool tenth = done == all || done * 10 / all != (done - 1) * 10 / all;
  if (terminal || tenth) {
    std::fprintf(stderr, "%sframe %zu of %zu, %.1f ms a frame%s", terminal ? "\r" : "", done, all,
                 watch.Milliseconds() / static_cast<double>(done), terminal && done < all ? "" : "\n");
  }
  return interrupted == 0;
}

int Run(const Arguments& arguments) {
  Result<SyntheticSequence> sequence = SyntheticSequence::Make(arguments.sequence);
  if (!sequence.ok()) {
    std::fprintf(stderr, "portolan_synth: %s\n", sequence.error().message.c_str());
    return kExitUsage;
  }
  const Stopwatch watch;
  const auto progress = [&](size_t done, size_t all) {
    return arguments.quiet ? interrupted == 0 : ShowProgress(done, all, watch);
  };
  const Status written = WriteSequence(*sequence, arguments.writer, progress);
  if (!written.ok()) {
    std::fprintf(stderr, "portolan_synth: %s\n", written.error().message.c_str());
    return kExitFailure;
  }
  return 0;
}

int Main(int argc, char** argv) {
  CLI::App app("Renders a synthetic place along a camera's way to a data set with exact ground truth.",
               "portolan_synth");
  app.set_version_flag("--version", "portolan_synth " + BuildDescription());
  Arguments arguments;
  AddOptions(&app, &arguments);
  if (const auto code = ParseCommandLine(&app, argc, argv)) return *code;
  if (!ParseSize(arguments.size, &arguments.sequence)) {
    std::fprintf(stderr, "portolan_synth: --size: '%s', expected WIDTHxHEIGHT as in 640x480\n", arguments.size.c_str());
    return kExitUsage;
  }
  arguments.sequence.lens = {arguments.lens.first, arguments.lens.second};
  arguments.writer.layout = Layouts().at(arguments.layout);
  arguments.writer.format = Formats().at(arguments.format);
  std::signal(SIGINT, [](int) { interrupted = 1; });
  std::signal(SIGTERM, [](int) { interrupted = 1; });
  cv::setNumThreads(1);  // frames are rendered one after another: more threads would only wait for each other
  return Run(arguments);
}

}  // namespace
}  // namespace portolan

int main(int argc, char** argv) {
  return portolan::Main(argc, argv);
}
