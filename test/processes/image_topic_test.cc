// Images over DDS: portolan_play publishes as a ROS 2 camera driver would, the frontend tracks.

#include "messages/random_messages.h"
#include "processes/process_test.h"
#include "processes/run_output_check.h"
#include "transport/raw_bus.h"
#include "transport/topics.h"

namespace portolan {
namespace {

struct Playback {
  const char* name;
  DdsVendor frontend, player;
  bool compressed;
};

class ImageTopicTest : public ProcessTest, public ::testing::WithParamInterface<Playback> {};

TEST_P(ImageTopicTest, FrontendTracksWhatIsPlayed) {
  const auto run = Start(
      RunCommand({"--data", "topic", "--camera", Sequence() + "/camera.yaml", "--dds", ToString(GetParam().frontend)}));
  StatusWatch watch(DdsVendor::kFastDds, domain_);
  ASSERT_TRUE(watch.WaitUntil(
      [](const StatusWatch::Heard& heard) {
        const ProcessStatus* frontend = heard.Of("frontend_tracker");
        return frontend != nullptr && frontend->state == "initializing";  // its peers are there: it waits for images
      },
      kProcessDeadline))
      << Logs();
  std::vector<std::string> play = {Program("portolan_play"),
                                   "--data",
                                   Sequence(),
                                   "--speed",
                                   RealTimeSpeed(0.5),
                                   "--quiet",
                                   "--domain",
                                   std::to_string(domain_),
                                   "--dds",
                                   ToString(GetParam().player)};
  if (GetParam().compressed) play.push_back("--compressed");
  const auto player = Start(play);

  // Beside them an image that is not of this camera, one that is older than any of it, and bytes that are no image.
  const auto stranger = watch.bus()->CreateWriter<Image>();
  auto raw_bus = MakeRawBus(TestBusOptions(DdsVendor::kCycloneDds, domain_));
  ASSERT_TRUE(raw_bus.ok()) << raw_bus.error().message;
  auto raw = (*raw_bus)->CreateWriter(
      RawTopic{BusOptions().image_topic, Topic<Image>::kType, Topic<Image>::kKeyed, Topic<Image>::Qos()});
  ASSERT_TRUE(raw.ok()) << raw.error().message;
  Random random(1);
  const Image foreign = RandomImage(64, 48, &random);
  Image old = RandomImage(320, 240, &random);
  old.stamp = Timestamp{-1000000000};
  const auto deadline = std::chrono::steady_clock::now() + kProcessDeadline;
  bool counted = false;
  while (!counted && std::chrono::steady_clock::now() < deadline) {
    for (const Image& image : {foreign, old}) stranger->Write(image);
    ASSERT_TRUE((*raw)->Write(SampleBytes(100, 0)).ok());
    counted = watch.WaitUntil(
        [](const StatusWatch::Heard& heard) {
          return heard.Figure("frontend_tracker", "frames_unreadable") >= 4 &&
                 heard.Figure("frontend_tracker", "malformed") >= 1;
        },
        std::chrono::milliseconds(200));
  }
  EXPECT_TRUE(counted) << Logs();

  const Ended played = WaitForEnd(player.get());
  EXPECT_EQ(played.code, 0) << played.output;
  const Ended ended = WaitForEnd(run.get());
  ASSERT_EQ(ended.code, 0) << ended.output << Logs();
  ExpectWholeOutput(Out());
  EXPECT_GT(Report("summary")["tracked"], 0.8 * static_cast<double>(NumFrames()));
  EXPECT_GE(Report("frontend_tracker")["unreadable"], 4);
  EXPECT_THAT(Logs(), ::testing::HasSubstr("which is not after"));
  EXPECT_GE(Report("frontend_tracker")["counters"][BusOptions().image_topic]["malformed"], 1);
  ExpectAccurate(Truth(), Out() + "/trajectory.txt", 0.01);
}

using ImageTopicEndTest = ProcessTest;

TEST_F(ImageTopicEndTest, WithoutAnImageNobodyIsReached) {
  const Ended run = RunToEnd(
      RunCommand({"--data", "topic", "--camera", Sequence() + "/camera.yaml", "--set", "source.first_image_s=1"}));
  EXPECT_EQ(run.code, 3) << run.output << Logs();
  EXPECT_THAT(run.output + Logs(), ::testing::HasSubstr("no image on topic 'rt/image'"));
}

/// While it waits for an image that never comes.
TEST_F(ImageTopicEndTest, TheUserEndsItAtOnce) {
  const auto run = Start(RunCommand({"--data", "topic", "--camera", Sequence() + "/camera.yaml", "--set",
                                     "source.first_image_s=0", "--set", "source.pause_s=0"}));
  StatusWatch watch(DdsVendor::kFastDds, domain_);
  ASSERT_TRUE(watch.WaitUntil(
      [](const StatusWatch::Heard& heard) {
        const ProcessStatus* frontend = heard.Of("frontend_tracker");
        return frontend != nullptr && frontend->state == "initializing";
      },
      kProcessDeadline))
      << Logs();
  run->Send(SIGINT);
  const Ended ended = WaitForEnd(run.get());
  EXPECT_EQ(ended.code, 130) << ended.output;  // and not killed by the launcher, which is patient for 20 s
}

INSTANTIATE_TEST_SUITE_P(Vendors, ImageTopicTest,
                         ::testing::Values(Playback{"raw_on_fastdds", DdsVendor::kFastDds, DdsVendor::kFastDds, false},
                                           Playback{"compressed_from_fastdds_to_cyclonedds", DdsVendor::kCycloneDds,
                                                    DdsVendor::kFastDds, true},
                                           Playback{"raw_from_cyclonedds_to_fastdds", DdsVendor::kFastDds,
                                                    DdsVendor::kCycloneDds, false}),
                         [](const auto& parameter) { return parameter.param.name; });

}  // namespace
}  // namespace portolan
