#include "dataset/playback_clock.h"

#include <cmath>

#include "base/check.h"

namespace portolan {

PlaybackClock::PlaybackClock(double factor) : factor_(factor) {
  PORTOLAN_CHECK(factor > 0 && std::isfinite(factor)) << "playback factor " << factor;
}

void PlaybackClock::Start(Timestamp first_stamp, TimePoint now) {
  first_stamp_ = first_stamp;
  start_ = now;
  started_ = true;
}

PlaybackClock::TimePoint PlaybackClock::DueAt(Timestamp stamp) const {
  PORTOLAN_CHECK(started_) << "the playback has not started";
  const std::chrono::duration<double> after_start(SecondsBetween(first_stamp_, stamp) / factor_);
  return start_ + std::chrono::duration_cast<PlaybackClock::TimePoint::duration>(after_start);
}

}  // namespace portolan
