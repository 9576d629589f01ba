// portolan_vocabulary: trains, inspects and converts vocabularies of visual words. Exit codes: 0 success, 1 failure, 2
// bad usage or input.

#include <unistd.h>

#include <fmt/format.h>
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <string>
#include <vector>

#include "base/command_line.h"
#include "base/hash.h"
#include "base/result.h"
#include "base/time.h"
#include "features/orb_extractor.h"
#include "version/version.h"
#include "vocabulary/vocabulary.h"
#include "vocabulary/vocabulary_file.h"
#include "vocabulary/vocabulary_training.h"

namespace portolan {
namespace {

namespace fs = std::filesystem;
using VocabularyResult = Result<std::shared_ptr<const Vocabulary>>;

constexpr int kSuccess = 0, kFailure = 1, kBadInput = 2;

struct TrainArguments {
  std::vector<std::string> images;  // files and folders
  VocabularyTrainingOptions training;
  OrbOptions orb;
  std::string output;
};

int Report(const Error& error, int exit_code) {
  fmt::print(stderr, "portolan_vocabulary: {}\n", error.message);
  return exit_code;
}

/// Shows the progress of a stage on standard error: a line that is written over on a terminal, else one line per ten
/// percent.
class ProgressLine {
 public:
  explicit ProgressLine(std::string stage) : stage_(std::move(stage)) {}
  void Show(double share) {
    const int step_percent = isatty(STDERR_FILENO) != 0 ? 1 : 10;
    const int percent = static_cast<int>(share * 100 + 1e-6) / step_percent * step_percent;
    if (percent == shown_percent_) return;
    shown_percent_ = percent;
    fmt::print(stderr, "{}{}: {} %{}", step_percent == 1 ? "\r" : "", stage_, percent,
               step_percent == 1 && percent < 100 ? "" : "\n");
  }

 private:
  const std::string stage_;
  int shown_percent_ = -1;
};

bool HasImageExtension(const fs::path& path) {
  std::string extension = path.extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  static const std::vector<std::string> kExtensions = {".png", ".jpg", ".jpeg", ".pgm",
                                                       ".ppm", ".bmp", ".tif",  ".tiff"};
  return std::find(kExtensions.begin(), kExtensions.end(), extension) != kExtensions.end();
}

/// The image files that the arguments name, folders resolved to their images by name.
Result<std::vector<std::string>> ListImages(const std::vector<std::string>& arguments) {
  std::vector<std::string> files;
  for (const std::string& argument : arguments) {
    std::error_code error;
    if (!fs::is_directory(argument, error)) {
      files.push_back(argument);
      continue;
    }
    std::vector<std::string> in_folder;
    for (fs::directory_iterator entry(argument, error), end; !error && entry != end; entry.increment(error)) {
      if (HasImageExtension(entry->path())) in_folder.push_back(entry->path().string());
    }
    if (error) return Error{fmt::format("folder {}: cannot be read: {}", argument, error.message())};
    if (in_folder.empty()) return Error{fmt::format("folder {}: no image in it", argument)};
    std::sort(in_folder.begin(), in_folder.end());
    files.insert(files.end(), in_folder.begin(), in_folder.end());
  }
  return files;
}

/// The descriptors of each image file.
Result<std::vector<std::vector<Descriptor>>> ExtractDescriptors(const std::vector<std::string>& files,
                                                                const OrbOptions& options) {
  OrbExtractor extractor(options);
  ProgressLine progress("features");
  std::vector<std::vector<Descriptor>> descriptors;
  for (const std::string& file : files) {
    const cv::Mat grey = cv::imread(file, cv::IMREAD_GRAYSCALE);
    if (grey.empty()) return Error{fmt::format("image {}: missing, or of no format that OpenCV reads", file)};
    CameraModel camera;  // of no lens: only the descriptors are wanted
    camera.pinhole.width = grey.cols;
    camera.pinhole.height = grey.rows;
    descriptors.push_back(extractor.Extract(grey, camera).descriptors);
    progress.Show(static_cast<double>(descriptors.size()) / static_cast<double>(files.size()));
  }
  return descriptors;
}

void PrintInfo(const std::string& path, const Vocabulary& vocabulary, double open_ms) {
  fmt::print("file: {}\nbranching: {}\ndepth: {}\nnodes: {}\nwords: {}\nhash: {}\nopened_ms: {:.2f}\n", path,
             vocabulary.branching(), vocabulary.depth(), vocabulary.num_nodes(), vocabulary.num_words(),
             FormatHash(vocabulary.hash()), open_ms);
}

int Info(const std::string& path) {
  const Stopwatch stopwatch;
  const VocabularyResult vocabulary = Vocabulary::Open(path);
  const double open_ms = stopwatch.Milliseconds();
  if (!vocabulary) return Report(vocabulary.error(), kBadInput);
  PrintInfo(path, **vocabulary, open_ms);
  return kSuccess;
}

/// Writes the file and prints what came out, as read back.
int SaveAndShow(const Vocabulary& vocabulary, const std::string& output) {
  if (const Status status = SaveVocabulary(vocabulary, output); !status) return Report(status.error(), kFailure);
  return Info(output);
}

int Train(const TrainArguments& arguments) {
  for (const Status& status : {arguments.training.Check(), arguments.orb.Check()}) {
    if (!status) return Report(status.error(), kBadInput);
  }
  const auto files = ListImages(arguments.images);
  if (!files) return Report(files.error(), kBadInput);
  const auto descriptors = ExtractDescriptors(*files, arguments.orb);
  if (!descriptors) return Report(descriptors.error(), kBadInput);
  ProgressLine progress("clusters");
  const VocabularyResult vocabulary =
      TrainVocabulary(*descriptors, arguments.training, [&](double share) { progress.Show(share); });
  if (!vocabulary) return Report(vocabulary.error(), kBadInput);
  return SaveAndShow(**vocabulary, arguments.output);
}

int Convert(const std::string& input, const std::string& output) {
  const VocabularyResult vocabulary = Vocabulary::ReadDbow2Text(input);
  if (!vocabulary) return Report(vocabulary.error(), kBadInput);
  return SaveAndShow(**vocabulary, output);
}

int Main(int argc, char** argv) {
  cv::setNumThreads(1);
  CLI::App app("Trains, inspects and converts vocabularies of visual words.");
  app.set_version_flag("--version", "portolan_vocabulary " + BuildDescription());
  app.require_subcommand(1);
  TrainArguments arguments;
  arguments.orb.num_features = 1000;
  std::string input;

  CLI::App* train = app.add_subcommand("train", "Builds a vocabulary from images.");
  train->add_option("images", arguments.images, "Image files, and folders of them")->required();
  train->add_option("-k,--branching", arguments.training.branching, "Children of a node")->capture_default_str();
  train->add_option("-L,--depth", arguments.training.depth, "Levels of the tree")->capture_default_str();
  train->add_option("--seed", arguments.training.seed, "Seed: the same seed and images give the same file")
      ->capture_default_str();
  train->add_option("--features", arguments.orb.num_features, "ORB features of each image")->capture_default_str();
  train->add_option("-o,--output", arguments.output, "Vocabulary to write")->required();

  CLI::App* info = app.add_subcommand("info", "Checks a vocabulary and tells what it is.");
  info->add_option("file", input, "Vocabulary")->required();

  CLI::App* convert = app.add_subcommand("convert", "Turns a vocabulary in DBoW2's text format into Portolan's.");
  convert->add_option("dbow2", input, "DBoW2 text file")->required();
  convert->add_option("-o,--output", arguments.output, "Vocabulary to write")->required();

  if (const auto code = ParseCommandLine(&app, argc, argv)) return *code;
  if (train->parsed()) return Train(arguments);
  return info->parsed() ? Info(input) : Convert(input, arguments.output);
}

}  // namespace
}  // namespace portolan

int main(int argc, char** argv) {
  try {
    return portolan::Main(argc, argv);
  } catch (const std::exception& error) {
    return portolan::Report(portolan::Error{error.what()}, portolan::kFailure);
  }
}
