#include "transport/typed_endpoints.h"

namespace portolan {
namespace internal {
namespace {

/// Raw and compressed images as one source.
class ImageReader final : public Reader {
 public:
  ImageReader(BusCore* core, std::function<void(Image)> handler) : handler_(std::move(handler)) {
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

}  // namespace

template <>
std::unique_ptr<Reader> MakeReader<Image>(BusCore* core, std::function<void(Image)> handler,
                                          std::function<void(int)> /*on_liveliness_changed*/) {
  return std::make_unique<ImageReader>(core, std::move(handler));
}

}  // namespace internal

template std::unique_ptr<Writer<Image>> Bus::CreateWriter<Image>();
template std::unique_ptr<Writer<CompressedImage>> Bus::CreateWriter<CompressedImage>();
template std::unique_ptr<Reader> Bus::CreateReader<Image>(std::function<void(Image)>, std::function<void(int)>);

}  // namespace portolan
