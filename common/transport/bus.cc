#include "transport/bus.h"

#include <spdlog/spdlog.h>

#include <mutex>
#include <type_traits>
#include <utility>

#include "base/log.h"
#include "messages/wire_codec.h"
#include "transport/raw_bus.h"
#include "transport/topic_counters.h"
#include "transport/topics.h"

namespace portolan {

namespace internal {
struct BusCore {
  BusOptions options;
  CounterTable counters;
  std::unique_ptr<RawBus> raw;
};
}  // namespace internal

namespace {

using Counters = std::shared_ptr<AtomicTopicCounters>;

template <class T>
RawTopic RawTopicOf(const BusOptions& options) {
  if constexpr (std::is_same_v<T, Image>) {
    return RawTopic{options.image_topic, Topic<T>::kType, Topic<T>::kKeyed, Topic<T>::Qos()};
  } else if constexpr (std::is_same_v<T, CompressedImage>) {
    return RawTopic{options.image_topic + Topic<T>::kSuffix, Topic<T>::kType, Topic<T>::kKeyed, Topic<T>::Qos()};
  } else {
    return RawTopic{Topic<T>::kName, Topic<T>::kType, Topic<T>::kKeyed, Topic<T>::Qos()};
  }
}

template <class T>
class TypedWriter final : public Writer<T> {
 public:
  TypedWriter(std::string name, std::unique_ptr<RawWriter> raw, Counters counters)
      : name_(std::move(name)), raw_(std::move(raw)), counters_(std::move(counters)) {}

  bool Write(const T& message) override {
    SampleBytes sample = EncodeSample(ToWire(message));
    const size_t bytes = sample.size();
    const Status written = raw_->Write(std::move(sample));
    if (!written.ok()) {
      ++counters_->send_failures;
      LogFailure(written.error());
      return false;
    }
    ++counters_->sent;
    counters_->sent_bytes += bytes;
    return true;
  }
  int MatchedReaders() const override { return raw_->MatchedReaders(); }
  void AssertLiveliness() override { raw_->AssertLiveliness(); }
  bool WaitForAcknowledgments(double seconds) override { return raw_->WaitForAcknowledgments(seconds); }

 private:
  void LogFailure(const Error& error) {
    std::lock_guard<std::mutex> lock(log_mutex_);
    if (throttle_.Allow()) {
      spdlog::warn("{}: DDS did not take a message: {} ({} more since the last warning)", name_, error.message,
                   throttle_.suppressed());
    }
  }

  const std::string name_;
  const std::unique_ptr<RawWriter> raw_;
  const Counters counters_;
  std::mutex log_mutex_;
  LogThrottle throttle_;
};

/// Decodes, validates and counts the samples of one topic; lives in its reader's thread.
template <class T, class Wire>
class SampleIntake {
 public:
  SampleIntake(std::string name, std::function<void(T)> handler, Counters counters)
      : name_(std::move(name)), handler_(std::move(handler)), counters_(std::move(counters)) {}

  void operator()(const uint8_t* data, size_t size) {
    ++counters_->received;
    counters_->received_bytes += size;
    const Result<Wire> wire = DecodeSample<Wire>(data, size);
    if (!wire.ok()) return Refuse(wire.error());
    Result<T> message = FromWire(*wire);
    if (!message.ok()) return Refuse(message.error());
    handler_(std::move(message).value());
  }

 private:
  void Refuse(const Error& error) {
    ++counters_->malformed;
    if (throttle_.Allow()) {
      spdlog::warn("{}: dropped a malformed message: {} ({} more since the last warning)", name_, error.message,
                   throttle_.suppressed());
    }
  }

  const std::string name_;
  const std::function<void(T)> handler_;
  const Counters counters_;
  LogThrottle throttle_;
};

template <class T, class Wire>
std::unique_ptr<Reader> MakeTypedReader(internal::BusCore* core, const RawTopic& topic, std::function<void(T)> handler,
                                        std::function<void(int)> on_liveliness_changed) {
  const Counters counters = core->counters.ForTopic(topic.name);
  const auto intake = std::make_shared<SampleIntake<T, Wire>>(topic.name, std::move(handler), counters);
  RawReaderEvents events;
  events.on_sample = [intake](const uint8_t* data, size_t size) { (*intake)(data, size); };
  events.on_liveliness_changed = std::move(on_liveliness_changed);
  events.on_lost = [counters](uint64_t count) { counters->lost += count; };
  Result<std::unique_ptr<Reader>> reader = core->raw->CreateReader(topic, std::move(events));
  PORTOLAN_CHECK(reader.ok()) << "reader of " << topic.name << ": " << reader.error().message;
  return std::move(reader).value();
}

/// Raw and compressed images as one source.
class ImageReader final : public Reader {
 public:
  ImageReader(internal::BusCore* core, std::function<void(Image)> handler) : handler_(std::move(handler)) {
    const auto deliver = [this](Image image) { Deliver(std::move(image)); };
    raw_ = MakeTypedReader<Image, Topic<Image>::Wire>(core, RawTopicOf<Image>(core->options), deliver, nullptr);
    compressed_ = MakeTypedReader<Image, Topic<CompressedImage>::Wire>(core, RawTopicOf<CompressedImage>(core->options),
                                                                       deliver, nullptr);
  }

  int MatchedWriters() const override { return raw_->MatchedWriters() + compressed_->MatchedWriters(); }
  int AliveWriters() const override { return raw_->AliveWriters() + compressed_->AliveWriters(); }

 private:
  void Deliver(Image image) {
    std::lock_guard<std::mutex> lock(mutex_);  // two readers, two threads
    image.frame = next_frame_++;
    handler_(std::move(image));
  }

  const std::function<void(Image)> handler_;
  std::mutex mutex_;
  uint64_t next_frame_ = 0;
  std::unique_ptr<Reader> raw_;
  std::unique_ptr<Reader> compressed_;
};

class DdsBus final : public Bus {
 public:
  DdsBus(BusOptions options, std::unique_ptr<RawBus> raw) {
    core_.options = std::move(options);
    core_.raw = std::move(raw);
  }
  std::map<std::string, TopicCounters> Counters() const override { return core_.counters.Load(); }
  DdsVendor vendor() const override { return core_.options.vendor; }

 private:
  internal::BusCore& core() override { return core_; }
  internal::BusCore core_;
};

}  // namespace

template <class T>
std::unique_ptr<Writer<T>> Bus::CreateWriter() {
  const RawTopic topic = RawTopicOf<T>(core().options);
  Result<std::unique_ptr<RawWriter>> raw = core().raw->CreateWriter(topic);
  PORTOLAN_CHECK(raw.ok()) << "writer of " << topic.name << ": " << raw.error().message;
  return std::make_unique<TypedWriter<T>>(topic.name, std::move(raw).value(), core().counters.ForTopic(topic.name));
}

template <class T>
std::unique_ptr<Reader> Bus::CreateReader(std::function<void(T)> handler,
                                          std::function<void(int)> on_liveliness_changed) {
  if constexpr (std::is_same_v<T, Image>) {
    return std::make_unique<ImageReader>(&core(), std::move(handler));
  } else {
    return MakeTypedReader<T, typename Topic<T>::Wire>(&core(), RawTopicOf<T>(core().options), std::move(handler),
                                                       std::move(on_liveliness_changed));
  }
}

Result<std::unique_ptr<Bus>> MakeBus(const BusOptions& options) {
  Result<std::unique_ptr<RawBus>> raw = MakeRawBus(options);
  if (!raw.ok()) return raw.error();
  return std::unique_ptr<Bus>(std::make_unique<DdsBus>(options, std::move(raw).value()));
}

#define PORTOLAN_INSTANTIATE_TOPIC(T)                         \
  template std::unique_ptr<Writer<T>> Bus::CreateWriter<T>(); \
  template std::unique_ptr<Reader> Bus::CreateReader<T>(std::function<void(T)>, std::function<void(int)>);
PORTOLAN_INSTANTIATE_TOPIC(KeyFrameMessage)
PORTOLAN_INSTANTIATE_TOPIC(MapDeltaChunk)
PORTOLAN_INSTANTIATE_TOPIC(SnapshotRequest)
PORTOLAN_INSTANTIATE_TOPIC(MapCorrection)
PORTOLAN_INSTANTIATE_TOPIC(Command)
PORTOLAN_INSTANTIATE_TOPIC(Request)
PORTOLAN_INSTANTIATE_TOPIC(Reply)
PORTOLAN_INSTANTIATE_TOPIC(TrackerState)
PORTOLAN_INSTANTIATE_TOPIC(MapperState)
PORTOLAN_INSTANTIATE_TOPIC(LoopState)
PORTOLAN_INSTANTIATE_TOPIC(ProcessStatus)
PORTOLAN_INSTANTIATE_TOPIC(Image)
#undef PORTOLAN_INSTANTIATE_TOPIC
template std::unique_ptr<Writer<CompressedImage>> Bus::CreateWriter<CompressedImage>();

}  // namespace portolan
