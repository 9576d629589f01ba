#pragma once

#include <spdlog/spdlog.h>

#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <type_traits>
#include <utility>

#include "base/log.h"
#include "messages/wire_codec.h"
#include "transport/bus.h"
#include "transport/raw_bus.h"
#include "transport/topic_counters.h"
#include "transport/topics.h"

// Writers and readers of domain types over those of serialised samples, for the files that instantiate them: images
// have one of their own, so that only programs which use them load OpenCV's codecs and the hundred libraries behind
// them.

namespace portolan::internal {

struct BusCore {
  BusOptions options;
  CounterTable counters;
  std::unique_ptr<RawBus> raw;
};

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
std::unique_ptr<Reader> MakeTypedReader(BusCore* core, const RawTopic& topic, std::function<void(T)> handler,
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

/// Image has its own (image_bus.cc).
template <class T>
std::unique_ptr<Reader> MakeReader(BusCore* core, std::function<void(T)> handler,
                                   std::function<void(int)> on_liveliness_changed) {
  return MakeTypedReader<T, typename Topic<T>::Wire>(core, RawTopicOf<T>(core->options), std::move(handler),
                                                     std::move(on_liveliness_changed));
}

}  // namespace portolan::internal

namespace portolan {

template <class T>
std::unique_ptr<Writer<T>> Bus::CreateWriter() {
  const RawTopic topic = internal::RawTopicOf<T>(core().options);
  Result<std::unique_ptr<RawWriter>> raw = core().raw->CreateWriter(topic);
  PORTOLAN_CHECK(raw.ok()) << "writer of " << topic.name << ": " << raw.error().message;
  return std::make_unique<internal::TypedWriter<T>>(topic.name, std::move(raw).value(),
                                                    core().counters.ForTopic(topic.name));
}

template <class T>
std::unique_ptr<Reader> Bus::CreateReader(std::function<void(T)> handler,
                                          std::function<void(int)> on_liveliness_changed) {
  return internal::MakeReader<T>(&core(), std::move(handler), std::move(on_liveliness_changed));
}

}  // namespace portolan
