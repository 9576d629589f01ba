#include "transport/bus.h"

#include <utility>

#include "transport/typed_endpoints.h"

namespace portolan {
namespace {

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

Result<std::unique_ptr<Bus>> MakeBus(const BusOptions& options) {
  Result<std::unique_ptr<RawBus>> raw = MakeRawBus(options);
  if (!raw.ok()) return raw.error();
  return std::unique_ptr<Bus>(std::make_unique<DdsBus>(options, std::move(raw).value()));
}

#define PORTOLAN_INSTANTIATE_TOPIC(T)                         \
  template std::unique_ptr<Writer<T>> Bus::CreateWriter<T>(); \
  template std::unique_ptr<Reader> Bus::CreateReader<T>(std::function<void(T)>, std::function<void(int)>);
PORTOLAN_FOR_EACH_TOPIC(PORTOLAN_INSTANTIATE_TOPIC)
#undef PORTOLAN_INSTANTIATE_TOPIC

}  // namespace portolan
