// What a strange participant may send: malformed samples on every topic, and whole messages that belong to nobody.
// Counted, and passed over.

#include <algorithm>

#include "messages/random_messages.h"
#include "messages/wire_codec.h"
#include "processes/process_test.h"
#include "processes/run_output_check.h"
#include "transport/raw_bus.h"
#include "transport/topics.h"
#include "vocabulary/vocabulary.h"

namespace portolan {
namespace {

/// Writes samples that can't be decoded to all topics of the processes, past the checks of the typed writers.
class MalformedWriter {
 public:
  MalformedWriter(DdsVendor vendor, int domain) {
    auto bus = MakeRawBus(TestBusOptions(vendor, domain));
    PORTOLAN_CHECK(bus.ok()) << bus.error().message;
    bus_ = std::move(bus).value();
    Add(RandomKeyFrame(50, &random_));
    Add(RandomDelta(300, &random_));
    Add(RandomSnapshotRequest(&random_));
    Add(RandomCorrection(&random_));
    Add(RandomCommand(&random_));
    Add(RandomRequest(&random_));
    Add(RandomReply(&random_));
    Add(RandomTrackerState(&random_));
    Add(RandomMapperState(&random_));
    Add(RandomFollowerState(&random_));
    Add(RandomProcessStatus(&random_));
  }

  /// Two samples on each topic.
  void WriteAll() {
    for (const auto& [writer, samples] : writers_) {
      for (const SampleBytes& sample : samples) static_cast<void>(writer->Write(sample).ok());
    }
  }

 private:
  template <class T>
  void Add(const T& valid) {
    auto writer = bus_->CreateWriter(RawTopic{Topic<T>::kName, Topic<T>::kType, Topic<T>::kKeyed, Topic<T>::Qos()});
    PORTOLAN_CHECK(writer.ok()) << writer.error().message;
    SampleBytes cut = EncodeSample(ToWire(valid));
    cut.resize(cut.size() / 2);
    SampleBytes noise = {0, 1, 0, 0};  // plain CDR, little-endian
    while (noise.size() < 100) noise.push_back(static_cast<uint8_t>(128 + random_.Below(128)));
    writers_.emplace_back(std::move(writer).value(), std::vector<SampleBytes>{cut, noise});
  }

  Random random_{1};
  std::unique_ptr<RawBus> bus_;
  std::vector<std::pair<std::unique_ptr<RawWriter>, std::vector<SampleBytes>>> writers_;
};

/// What each process reads (docs/topics.md).
const std::map<std::string, std::vector<std::string>> kReads = {
    {"frontend_tracker",
     {"map_delta", "mapper_state", "follower_state", "keyframe", "reply", "command", "process_status"}},
    {"backend_mapper", {"keyframe", "tracker_state", "command", "map_request", "reply", "map_delta", "correction"}},
    {"loop_closer", {"keyframe", "map_delta", "mapper_state", "tracker_state", "command", "process_status"}},
    {"atlas_server", {"process_status", "mapper_state", "keyframe", "map_delta", "map_request", "request"}}};

class BadMessageTest : public ProcessTest, public ::testing::WithParamInterface<DdsVendor> {
 protected:
  /// Calls `send` again and again until the processes' statuses show what is waited for.
  bool SendUntil(StatusWatch* watch, const std::function<void()>& send,
                 const std::function<bool(const StatusWatch::Heard&)>& shown,
                 std::chrono::milliseconds interval = std::chrono::milliseconds(250)) const {
    const auto deadline = std::chrono::steady_clock::now() + kProcessDeadline;
    while (std::chrono::steady_clock::now() < deadline) {
      send();
      if (watch->WaitUntil(shown, interval)) return true;
    }
    return false;
  }

  /// One that lasts longer than the processes take to hear a stranger, and doesn't depend on how busy the machine is.
  std::unique_ptr<ChildProcess> StartRun() {
    return Start(RunCommand({"--data", InRounds(kRounds), "--speed", "lockstep", "--dds", ToString(GetParam())}));
  }
  void ExpectGoodEnd(ChildProcess* run) {
    const Ended ended = WaitForEnd(run);
    ASSERT_EQ(ended.code, 0) << ended.output << Logs();
    ExpectWholeOutput(Out());
    EXPECT_GT(Report("summary")["tracked"], 0.8 * static_cast<double>(kRounds * kRound));
    EXPECT_EQ(Report("summary")["maps"], 1);
    ExpectSameMaps(Report("atlas_server"), Report("loop_closer"));
  }

  static constexpr int kRounds = 3;
};

TEST_P(BadMessageTest, MalformedSamplesAreCountedByEveryReader) {
  const auto run = StartRun();
  StatusWatch watch(DdsVendor::kFastDds, domain_);
  MalformedWriter writer(DdsVendor::kCycloneDds, domain_);
  EXPECT_TRUE(SendUntil(
      &watch, [&] { writer.WriteAll(); },
      [](const StatusWatch::Heard& heard) {
        return std::all_of(kReads.begin(), kReads.end(), [&](const auto& reads) {
          // More than one round of two samples a topic: by then every reader has met the writers.
          return heard.Figure(reads.first, "malformed") >= 8.0 * static_cast<double>(reads.second.size());
        });
      }))
      << Logs();
  ExpectGoodEnd(run.get());
  for (const auto& [role, topics] : kReads) {
    const nlohmann::json report = Report(role);
    for (const std::string& topic : topics)
      EXPECT_GT(report["counters"][topic].value("malformed", 0), 0) << role << " " << topic;
  }
}

TEST_P(BadMessageTest, MessagesOfNobodyChangeNothing) {
  const auto run = StartRun();
  StatusWatch watch(DdsVendor::kFastDds, domain_);
  Random random(1);
  const auto keyframes = watch.bus()->CreateWriter<KeyFrameMessage>();
  const auto deltas = watch.bus()->CreateWriter<MapDeltaChunk>();
  const auto corrections = watch.bus()->CreateWriter<MapCorrection>();
  const auto replies = watch.bus()->CreateWriter<Reply>();
  const KeyFrameMessage keyframe = RandomKeyFrame(50, &random);
  const MapDeltaChunk delta = RandomDelta(300, &random);
  const MapCorrection correction = RandomCorrection(&random);
  const Reply reply = RandomReply(&random);
  const auto send = [&] {
    keyframes->Write(keyframe);
    deltas->Write(delta);
    corrections->Write(correction);
    replies->Write(reply);
  };
  EXPECT_TRUE(SendUntil(&watch, send, [](const StatusWatch::Heard& heard) {
    return heard.Figure("backend_mapper", "foreign_vocabulary") >= 1 &&
           heard.Figure("atlas_server", "foreign_vocabulary") >= 1 &&
           heard.Figure("loop_closer", "foreign_keyframes") >= 1 && heard.Figure("frontend_tracker", "tracked") >= 1;
  })) << Logs();
  ExpectGoodEnd(run.get());
}

/// They come on the same topic, to be passed over: the mapper must not seem busy with them, or its own tracker would
/// wait for it and add nothing to the map.
TEST_P(BadMessageTest, KeyFramesOfAnotherRobotKeepNoMapperBusy) {
  const auto vocabulary = Vocabulary::HashOf(Program("../share/portolan/default.pvoc"));
  ASSERT_TRUE(vocabulary.ok()) << vocabulary.error().message;
  const auto run = StartRun();
  StatusWatch watch(DdsVendor::kFastDds, domain_);
  const auto writer = watch.bus()->CreateWriter<KeyFrameMessage>();
  Random random(1);
  KeyFrameMessage keyframe = RandomKeyFrame(50, &random);
  keyframe.vocabulary_hash = *vocabulary;
  keyframe.map = MapId(9, 1, 1);
  uint32_t number = 0;
  const auto send = [&] {
    keyframe.data.id = KeyFrameId(9, 1, ++number);
    writer->Write(keyframe);
  };
  const auto one_round = [](const StatusWatch::Heard& heard) { return heard.TrackerIsAt(kRound); };
  EXPECT_TRUE(SendUntil(&watch, send, one_round, std::chrono::milliseconds(5))) << Logs();
  ExpectGoodEnd(run.get());
  EXPECT_GE(Report("backend_mapper")["keyframes_taken"], 10);
  EXPECT_GT(number, 100u);
}

INSTANTIATE_TEST_SUITE_P(Vendors, BadMessageTest, ::testing::Values(DdsVendor::kFastDds, DdsVendor::kCycloneDds),
                         [](const auto& parameter) { return ToString(parameter.param); });

}  // namespace
}  // namespace portolan
