// portolan_orb_time: how long OpenCV's ORB takes on a sequence's frames, on one core: the measure for the tracker's
// time on this machine today.

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <opencv2/core.hpp>
#include <opencv2/features2d.hpp>
#include <string>
#include <vector>

#include "base/command_line.h"
#include "base/statistics.h"
#include "base/time.h"
#include "dataset/image_source.h"
#include "version/version.h"

namespace portolan {
namespace {

struct Arguments {
  SourceOptions source;
  int num_features = 2000;
  uint64_t num_samples = 30;
};

/// Milliseconds of detectAndCompute on about num_samples frames, evenly spread over the sequence. Unreadable frames are
/// passed over.
Result<std::vector<double>> MeasureOrb(const Arguments& arguments) {
  Result<std::unique_ptr<ImageSource>> opened = OpenImageSource(arguments.source);
  if (!opened) return opened.error();
  ImageSource& source = **opened;
  const uint64_t step =
      std::max<uint64_t>(1, source.NumFrames().value_or(arguments.num_samples) / arguments.num_samples);
  const cv::Ptr<cv::ORB> orb = cv::ORB::create(arguments.num_features, 1.2f, 8);
  std::vector<double> milliseconds;
  bool warm = false;  // the first call allocates
  while (true) {
    Result<std::optional<Image>> image = source.Next();
    if (image && !image->has_value()) return milliseconds;
    if (image) {
      std::vector<cv::KeyPoint> keypoints;
      cv::Mat descriptors;
      if (!warm) orb->detectAndCompute((*image)->grey, cv::noArray(), keypoints, descriptors);
      warm = true;
      const Stopwatch watch;
      orb->detectAndCompute((*image)->grey, cv::noArray(), keypoints, descriptors);
      milliseconds.push_back(watch.Milliseconds());
    }
    for (uint64_t i = 1; i < step; ++i) source.Skip();
  }
}

int Main(int argc, char** argv) {
  CLI::App app("Median milliseconds of cv::ORB(N, 1.2, 8)->detectAndCompute over a sequence, one thread.",
               "portolan_orb_time");
  app.set_version_flag("--version", "portolan_orb_time " + BuildDescription());
  Arguments arguments;
  app.add_option("data", arguments.source.data, "data set")->required();
  app.add_option("--camera", arguments.source.camera_file, "calibration (default: found in the data set)");
  app.add_option("--features", arguments.num_features, "N")->check(CLI::Range(100, 20000))->capture_default_str();
  app.add_option("--samples", arguments.num_samples, "frames measured")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  app.add_option("--first-frame", arguments.source.first_frame, "frames before it are passed over");
  app.add_option("--max-frames", arguments.source.max_frames, "0: all");
  if (const auto code = ParseCommandLine(&app, argc, argv)) return *code;
  cv::setNumThreads(1);
  Result<std::vector<double>> milliseconds = MeasureOrb(arguments);
  if (!milliseconds || milliseconds->empty()) {
    std::fprintf(stderr, "portolan_orb_time: %s\n",
                 milliseconds ? "no readable frame" : milliseconds.error().message.c_str());
    return 1;
  }
  std::printf("%.3f\n", Quantile(*milliseconds, 0.5));
  return 0;
}

}  // namespace
}  // namespace portolan

int main(int argc, char** argv) {
  return portolan::Main(argc, argv);
}
