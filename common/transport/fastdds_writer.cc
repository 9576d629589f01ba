#include "transport/fastdds_writer.h"

#include <spdlog/spdlog.h>

#include "transport/fastdds_qos.h"

namespace portolan {

namespace dds = eprosima::fastdds::dds;

Result<std::unique_ptr<RawWriter>> FastDdsWriter::Create(dds::Publisher* publisher, dds::Topic* topic,
                                                         const TopicQos& qos) {
  std::unique_ptr<FastDdsWriter> writer(new FastDdsWriter(publisher));
  writer->writer_ = publisher->create_datawriter(topic, FastDdsWriterQos(qos), writer.get(),
                                                 dds::StatusMask::offered_incompatible_qos());
  if (writer->writer_ == nullptr) return Error{"Fast DDS made no writer (the log says why)"};
  return std::unique_ptr<RawWriter>(std::move(writer));
}

FastDdsWriter::~FastDdsWriter() {
  if (writer_ == nullptr) return;
  writer_->set_listener(nullptr);
  // While a reader that died is not given up, heartbeats go on until the writer is gone, and Fast DDS 2.9.1 walks for
  // ever over samples that its destructor has released: none must be left by then.
  size_t removed = 0;
  writer_->clear_history(&removed);
  publisher_->delete_datawriter(writer_);
}

Status FastDdsWriter::Write(SampleBytes sample) {
  if (!writer_->write(&sample)) return Error{"Fast DDS: full, or out of memory"};
  return Ok{};
}

int FastDdsWriter::MatchedReaders() const {
  dds::PublicationMatchedStatus status;
  writer_->get_publication_matched_status(status);
  return status.current_count;
}

void FastDdsWriter::AssertLiveliness() {
  writer_->assert_liveliness();
}

bool FastDdsWriter::WaitForAcknowledgments(double seconds) {
  return writer_->wait_for_acknowledgments(FastDdsDuration(seconds)) == ReturnCode_t::RETCODE_OK;
}

void FastDdsWriter::on_offered_incompatible_qos(dds::DataWriter* writer,
                                                const dds::OfferedIncompatibleQosStatus& status) {
  spdlog::warn("{}: a reader asks for another quality of service (policy {}): not matched",
               writer->get_topic()->get_name(), static_cast<uint32_t>(status.last_policy_id));
}

}  // namespace portolan
