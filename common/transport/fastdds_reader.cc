#include "transport/fastdds_reader.h"

#include <spdlog/spdlog.h>

#include <fastdds/dds/subscriber/SampleInfo.hpp>

#include "transport/fastdds_qos.h"

namespace portolan {

namespace dds = eprosima::fastdds::dds;

Result<std::unique_ptr<Reader>> FastDdsReader::Create(dds::Subscriber* subscriber, dds::Topic* topic,
                                                      const TopicQos& qos, RawReaderEvents events) {
  std::unique_ptr<FastDdsReader> reader(new FastDdsReader(subscriber, qos.liveliness_lease_ms > 0, std::move(events)));
  reader->reader_ = subscriber->create_datareader(topic, FastDdsReaderQos(qos), nullptr, dds::StatusMask::none());
  if (reader->reader_ == nullptr) return Error{"Fast DDS made no reader (the log says why)"};
  dds::StatusCondition& condition = reader->reader_->get_statuscondition();
  condition.set_enabled_statuses(dds::StatusMask::data_available()
                                 << dds::StatusMask::liveliness_changed() << dds::StatusMask::sample_lost()
                                 << dds::StatusMask::sample_rejected()
                                 << dds::StatusMask::requested_incompatible_qos());
  reader->wait_set_.attach_condition(condition);
  reader->wait_set_.attach_condition(reader->stop_);
  reader->thread_ = std::thread([self = reader.get()] { self->Run(); });
  return std::unique_ptr<Reader>(std::move(reader));
}

FastDdsReader::~FastDdsReader() {
  if (reader_ == nullptr) return;
  stop_.set_trigger_value(true);
  if (thread_.joinable()) thread_.join();
  wait_set_.detach_condition(reader_->get_statuscondition());
  wait_set_.detach_condition(stop_);
  subscriber_->delete_datareader(reader_);
}

int FastDdsReader::MatchedWriters() const {
  dds::SubscriptionMatchedStatus status;
  reader_->get_subscription_matched_status(status);
  return status.current_count;
}

int FastDdsReader::AliveWriters() const {
  return has_lease_ ? alive_writers_.load() : MatchedWriters();
}

void FastDdsReader::Run() {
  dds::ConditionSeq active;
  while (true) {
    wait_set_.wait(active, eprosima::fastrtps::c_TimeInfinite);
    if (stop_.get_trigger_value()) return;
    HandleStatuses();
    TakeSamples();
  }
}

void FastDdsReader::HandleStatuses() {
  dds::LivelinessChangedStatus liveliness;
  reader_->get_liveliness_changed_status(liveliness);
  if (has_lease_ && alive_writers_.exchange(liveliness.alive_count) != liveliness.alive_count &&
      events_.on_liveliness_changed) {
    events_.on_liveliness_changed(liveliness.alive_count);
  }
  dds::SampleLostStatus lost;
  dds::SampleRejectedStatus rejected;
  reader_->get_sample_lost_status(lost);
  reader_->get_sample_rejected_status(rejected);
  const int gone = lost.total_count_change + static_cast<int>(rejected.total_count_change);
  if (gone > 0) events_.on_lost(static_cast<uint64_t>(gone));
  dds::RequestedIncompatibleQosStatus incompatible;
  reader_->get_requested_incompatible_qos_status(incompatible);
  if (incompatible.total_count_change > 0) {
    spdlog::warn("{}: a writer offers another quality of service (policy {}): not matched",
                 reader_->get_topicdescription()->get_name(), static_cast<uint32_t>(incompatible.last_policy_id));
  }
}

void FastDdsReader::TakeSamples() {
  dds::SampleInfo info;
  while (!stop_.get_trigger_value() && reader_->take_next_sample(&sample_, &info) == ReturnCode_t::RETCODE_OK) {
    if (info.valid_data) events_.on_sample(sample_.data(), sample_.size());
  }
}

}  // namespace portolan
