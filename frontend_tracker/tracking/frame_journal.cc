#include "tracking/frame_journal.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <map>
#include <sstream>
#include <utility>

#include "base/flat_yaml.h"

namespace portolan {
namespace {

constexpr const char* kTitle = "portolan-frames 1";
constexpr const char* kData = "data ";
constexpr double kRotationTolerance = 1e-6;  // numbers are written whole

std::string PoseText(const Rigid3d& pose) {
  const Eigen::Vector3d& t = pose.translation;
  const Eigen::Quaterniond& q = pose.rotation;
  return fmt::format("{} {} {} {} {} {} {}", t.x(), t.y(), t.z(), q.x(), q.y(), q.z(), q.w());
}

std::string FrameText(const FrameRecord& record) {
  return fmt::format("frame {} {} {} {} {} {} {}\n", record.frame, record.stamp.ns, record.map.value,
                     record.anchor.value, record.online ? 1 : 0, PoseText(record.camera_from_anchor),
                     PoseText(record.online_camera_from_map));
}

bool ReadPose(std::istream* fields, Rigid3d* pose) {
  std::array<double, 7> v{};
  for (double& value : v) {
    if (std::string field; !(*fields >> field) || !ParseNumber(field, &value)) return false;
  }
  const Eigen::Quaterniond rotation(v[6], v[3], v[4], v[5]);
  *pose = Rigid3d(rotation, {v[0], v[1], v[2]});
  return std::abs(rotation.norm() - 1) <= kRotationTolerance;
}

bool ReadFrame(std::istream* fields, FrameRecord* record) {
  int online = 0;
  *fields >> record->frame >> record->stamp.ns >> record->map.value >> record->anchor.value >> online;
  record->online = online == 1;
  return *fields && ReadPose(fields, &record->camera_from_anchor) && ReadPose(fields, &record->online_camera_from_map);
}

/// @return whether the line is one of the journal's.
bool ReadLine(const std::string& line, EarlierRun* run, std::map<uint64_t, FrameRecord>* frames) {
  if (line.rfind(kData, 0) == 0) {
    run->data = line.substr(std::strlen(kData));
    return true;
  }
  std::istringstream fields(line);
  std::string kind, rest;
  fields >> kind;
  if (kind == "start") {
    run->start.emplace();
    fields >> run->start->first_stamp.ns >> run->start->unix_time.ns;
  } else if (kind == "frame") {
    FrameRecord record;
    if (!ReadFrame(&fields, &record)) return false;
    (*frames)[record.frame] = record;
  } else {
    return false;
  }
  return fields && !(fields >> rest);
}

Error AtFile(const std::string& path) {
  return Error{path + ": " + std::strerror(errno)};
}

}  // namespace

FrameJournal::~FrameJournal() {
  if (file_ >= 0) close(file_);
}

FrameJournal& FrameJournal::operator=(FrameJournal&& other) noexcept {
  std::swap(path_, other.path_);
  std::swap(file_, other.file_);
  return *this;
}

Result<std::optional<EarlierRun>> FrameJournal::Read(const std::string& path) {
  if (!std::filesystem::exists(path)) return std::optional<EarlierRun>();
  const Result<std::string> text = ReadTextFile(path);
  if (!text) return text.error();
  EarlierRun run;
  std::map<uint64_t, FrameRecord> frames;
  size_t number = 0;
  for (size_t at = 0, end = 0; (end = text->find('\n', at)) != std::string::npos; at = end + 1) {
    const std::string line = text->substr(at, end - at);
    const bool known = ++number == 1 ? line == kTitle : ReadLine(line, &run, &frames);
    if (!known) {
      return Error{fmt::format("{}:{}: expected {}, found '{}'", path, number,
                               number == 1 ? kTitle : "'data', 'start' or 'frame' with its fields", line)};
    }
  }
  for (const auto& [frame, record] : frames) run.frames.push_back(record);
  return std::optional<EarlierRun>(std::move(run));
}

Result<FrameJournal> FrameJournal::Open(const std::string& path, int flags) {
  FrameJournal journal;
  journal.path_ = path;
  journal.file_ = open(path.c_str(), O_RDWR | O_APPEND | O_CLOEXEC | flags, 0644);
  if (journal.file_ < 0) return AtFile(path);
  return Result<FrameJournal>(std::move(journal));
}

Result<FrameJournal> FrameJournal::Begin(const std::string& path, const std::string& data) {
  Result<FrameJournal> journal = Open(path, O_CREAT | O_TRUNC);
  if (!journal) return journal;
  if (Status written = journal->Write(std::string(kTitle) + "\n" + kData + data + "\n"); !written)
    return written.error();
  return journal;
}

Result<FrameJournal> FrameJournal::GoOn(const std::string& path) {
  const Result<std::string> text = ReadTextFile(path);
  if (!text) return text.error();
  Result<FrameJournal> journal = Open(path, 0);
  const size_t last = text->rfind('\n');
  const size_t whole = last == std::string::npos ? 0 : last + 1;
  if (journal && ftruncate(journal->file_, static_cast<off_t>(whole)) != 0) return AtFile(path);
  return journal;
}

Status FrameJournal::NoteStart(const EarlierRun::Start& start) {
  return Write(fmt::format("start {} {}\n", start.first_stamp.ns, start.unix_time.ns));
}

Status FrameJournal::Append(const std::vector<FrameRecord>& frames) {
  std::string text;
  for (const FrameRecord& frame : frames) text += FrameText(frame);
  return Write(text);
}

Status FrameJournal::Write(const std::string& text) {
  for (size_t done = 0; file_ >= 0 && done < text.size();) {
    const ssize_t written = write(file_, text.data() + done, text.size() - done);
    if (written < 0 && errno == EINTR) continue;
    if (written < 0) return AtFile(path_);
    done += static_cast<size_t>(written);
  }
  return Ok{};
}

void FrameJournal::Remove() {
  if (file_ < 0) return;
  close(std::exchange(file_, -1));
  unlink(path_.c_str());
}

}  // namespace portolan
