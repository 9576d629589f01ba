#include "process/status_publisher.h"

#include <unistd.h>

#include "process/process_report.h"
#include "version/version.h"

namespace portolan {

StatusPublisher::StatusPublisher(Bus* bus, const ProcessSetup& setup, const std::string& priority)
    : bus_(bus), writer_(bus->CreateWriter<ProcessStatus>()) {
  char host[256] = "";
  gethostname(host, sizeof host - 1);
  fixed_.process = setup.process;
  fixed_.role = setup.options.role;
  fixed_.host = host;
  fixed_.pid = static_cast<uint32_t>(getpid());
  fixed_.vendor = ToString(setup.options.bus.vendor);
  fixed_.build = BuildDescription();
  fixed_.priority = priority;
}

void StatusPublisher::Publish(const std::string& state, MapId map, Epoch epoch, Revision revision,
                              std::vector<std::pair<std::string, double>> figures) {
  ProcessStatus status = fixed_;
  status.state = state;
  status.map = map;
  status.epoch = epoch;
  status.revision = revision;
  TopicCounters sum;
  for (const auto& [topic, counters] : bus_->Counters()) {
    sum.sent_bytes += counters.sent_bytes;
    sum.received_bytes += counters.received_bytes;
    if (counters.sent_bytes > 0) figures.emplace_back("bytes_sent." + topic, static_cast<double>(counters.sent_bytes));
    sum.malformed += counters.malformed;
    sum.send_failures += counters.send_failures;
    sum.lost += counters.lost;
  }
  const ResourceUse resources = MeasureResources();
  figures.emplace_back("resident_bytes", resources.resident_bytes);
  figures.emplace_back("open_files", resources.open_files);
  figures.emplace_back("cpu_s", resources.cpu_s);
  figures.emplace_back("bytes_sent", static_cast<double>(sum.sent_bytes));
  figures.emplace_back("bytes_received", static_cast<double>(sum.received_bytes));
  figures.emplace_back("malformed", static_cast<double>(sum.malformed));
  figures.emplace_back("send_failures", static_cast<double>(sum.send_failures));
  figures.emplace_back("lost", static_cast<double>(sum.lost));
  status.figures = std::move(figures);
  writer_->Write(status);
}

}  // namespace portolan
