// portolan_play: publishes the images of a data set on the DDS image topic, in ROS 2's form, as a camera would.

#include <unistd.h>

#include <CLI/CLI.hpp>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <opencv2/core/utility.hpp>
#include <string>
#include <thread>

#include "base/command_line.h"
#include "base/log.h"
#include "base/time.h"
#include "dataset/compressed_image.h"
#include "dataset/image_source.h"
#include "dataset/player.h"
#include "transport/bus.h"
#include "version/version.h"

namespace portolan {
namespace {

constexpr int kExitFailure = 1;
constexpr int kExitUnreachable = 3;  // nobody listens
constexpr int kExitInterrupted = 130;

constexpr auto kMatchCheck = std::chrono::milliseconds(50);  // between two looks for a subscriber
// After the last image: it is best effort, and may still be on its way out.
constexpr auto kLinger = std::chrono::milliseconds(300);
constexpr uint64_t kFramesAProgressLine = 100;  // where there is no terminal

volatile std::sig_atomic_t interrupted = 0;

struct Arguments {
  SourceOptions source;
  std::string speed = "1", vendor = "fastdds";
  BusOptions bus;
  std::string keys;
  double wait_s = 30;
  bool compressed = false;
  bool quiet = false;
};

void AddOptions(CLI::App* app, Arguments* arguments) {
  app->add_option("--data", arguments->source.data, "folder of a data set, video file or /dev/videoN")->required();
  app->add_option("--camera", arguments->source.camera_file, "calibration file (default: found in the data set)");
  app->add_option("--speed", arguments->speed, "factor of real time, or max")->capture_default_str();
  app->add_option("--dds", arguments->vendor, "fastdds or cyclonedds")->capture_default_str();
  app->add_option("--domain", arguments->bus.domain, "DDS domain, 0 to 230")->capture_default_str();
  app->add_option("--topic", arguments->bus.image_topic, "as on the wire: ROS 2's /camera/image is rt/camera/image")
      ->capture_default_str();
  app->add_option("--security", arguments->keys, "folder of make_keys.py's keys: DDS Security is on");
  app->add_option("--first-frame", arguments->source.first_frame, "frames before it are passed over")
      ->capture_default_str();
  app->add_option("--max-frames", arguments->source.max_frames, "0: all")->capture_default_str();
  app->add_option("--wait", arguments->wait_s, "seconds to wait for a subscriber")
      ->check(CLI::Range(0.0, 3600.0))
      ->capture_default_str();
  app->add_flag("--compressed", arguments->compressed, "JPEG on TOPIC/compressed in place of raw images");
  app->add_flag("--quiet", arguments->quiet, "no progress");
}

int Complain(const std::string& message, int exit_code) {
  std::fprintf(stderr, "portolan_play: %s\n", message.c_str());
  return exit_code;
}

/// Publishes on one of the two topics.
class ImagePublisher {
 public:
  ImagePublisher(Bus* bus, bool compressed) {
    if (compressed) {
      compressed_ = bus->CreateWriter<CompressedImage>();
    } else {
      raw_ = bus->CreateWriter<Image>();
    }
  }
  bool Publish(const Image& image) {
    return raw_ != nullptr ? raw_->Write(image) : compressed_->Write(CompressJpeg(image));
  }
  int NumSubscribers() const { return raw_ != nullptr ? raw_->MatchedReaders() : compressed_->MatchedReaders(); }

 private:
  std::unique_ptr<Writer<Image>> raw_;
  std::unique_ptr<Writer<CompressedImage>> compressed_;
};

/// @return whether someone listens within the time.
bool WaitForSubscriber(const ImagePublisher& publisher, double wait_s) {
  const Stopwatch watch;
  while (publisher.NumSubscribers() == 0) {
    if (interrupted != 0 || watch.Milliseconds() > wait_s * 1e3) return false;
    std::this_thread::sleep_for(kMatchCheck);
  }
  return true;
}

/// One line on a terminal, a line now and then elsewhere.
void ShowProgress(uint64_t frame, uint64_t sent, const PlaybackReport& report) {
  const bool terminal = isatty(STDERR_FILENO) != 0;
  if (!terminal && sent % kFramesAProgressLine != 0) return;
  std::fprintf(stderr, "%sframe %llu, sent %llu, dropped %llu%s", terminal ? "\r" : "",
               static_cast<unsigned long long>(frame), static_cast<unsigned long long>(sent),
               static_cast<unsigned long long>(report.dropped), terminal ? "  " : "\n");
}

int Play(Player* player, ImagePublisher* publisher, bool quiet) {
  uint64_t sent = 0, refused = 0;
  while (interrupted == 0) {
    const std::optional<PlayedFrame> frame = player->WaitForNext();
    if (!frame) break;
    (publisher->Publish(frame->image) ? sent : refused) += 1;
    if (!quiet) ShowProgress(frame->image.frame, sent, player->report());
  }
  std::this_thread::sleep_for(kLinger);
  const PlaybackReport report = player->report();
  if (!quiet && isatty(STDERR_FILENO) != 0) std::fprintf(stderr, "\n");
  for (const std::string& message : report.messages) std::fprintf(stderr, "portolan_play: %s\n", message.c_str());
  std::printf("sent %llu, dropped %llu, unreadable %llu, refused by DDS %llu\n", static_cast<unsigned long long>(sent),
              static_cast<unsigned long long>(report.dropped), static_cast<unsigned long long>(report.unreadable),
              static_cast<unsigned long long>(refused));
  if (interrupted != 0) return kExitInterrupted;
  return sent > 0 && refused == 0 ? 0 : kExitFailure;
}

int Run(Arguments* arguments) {
  const Result<DdsVendor> vendor = ParseDdsVendor(arguments->vendor);
  if (!vendor) return Complain("--dds: " + vendor.error().message, kExitUsage);
  arguments->bus.vendor = *vendor;
  if (!arguments->keys.empty()) arguments->bus.credentials_folder = arguments->keys + "/camera";
  if (Status checked = arguments->bus.Check(); !checked) return Complain(checked.error().message, kExitUsage);
  const Result<PlaybackOptions> playback = ParseSpeed(arguments->speed);
  if (!playback) return Complain("--speed: " + playback.error().message, kExitUsage);
  Result<std::unique_ptr<ImageSource>> source = OpenImageSource(arguments->source);
  if (!source) return Complain(source.error().message, kExitUsage);
  const Result<std::unique_ptr<Bus>> bus = MakeBus(arguments->bus);
  if (!bus) return Complain(bus.error().message, kExitFailure);
  ImagePublisher publisher(bus->get(), arguments->compressed);
  if (!WaitForSubscriber(publisher, arguments->wait_s)) {
    if (interrupted != 0) return kExitInterrupted;
    return Complain("nobody listens on topic '" + arguments->bus.image_topic +
                        (arguments->compressed ? "/compressed" : "") + "' in domain " +
                        std::to_string(arguments->bus.domain) + " within " +
                        std::to_string(static_cast<int>(arguments->wait_s)) + " s",
                    kExitUnreachable);
  }
  Player player(std::move(*source), *playback);
  return Play(&player, &publisher, arguments->quiet);
}

int Main(int argc, char** argv) {
  CLI::App app(
      "Publishes the images of a data set on the DDS image topic, in ROS 2's form, at their own rate.\n"
      "Exit code: 0 done, 1 nothing sent or DDS failed, 2 bad arguments or data, 3 nobody listens, 130 interrupted.",
      "portolan_play");
  app.set_version_flag("--version", "portolan_play " + BuildDescription());
  Arguments arguments;
  AddOptions(&app, &arguments);
  if (const auto code = ParseCommandLine(&app, argc, argv)) return *code;
  std::signal(SIGINT, [](int) { interrupted = 1; });
  std::signal(SIGTERM, [](int) { interrupted = 1; });
  cv::setNumThreads(1);
  return Run(&arguments);
}

}  // namespace
}  // namespace portolan

int main(int argc, char** argv) {
  return portolan::Main(argc, argv);
}
