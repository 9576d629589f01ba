#include "tracking/place_queries.h"

namespace portolan {

bool PlaceQueries::IsDue(Timestamp now) const {
  return !last_sent_ || SecondsBetween(*last_sent_, now) >= kIntervalS;
}

void PlaceQueries::NoteSent(Timestamp now) {
  last_sent_ = now;
  if (!unanswered_since_) unanswered_since_ = now;
}

void PlaceQueries::OnReply(bool found) {
  unanswered_since_.reset();
  if (!found) ++denials_;
}

bool PlaceQueries::MayBegin(Timestamp now) const {
  if (maps_in_atlas_ == 0 || denials_ >= kDenials) return true;
  return unanswered_since_ && SecondsBetween(*unanswered_since_, now) > kPatienceS;
}

}  // namespace portolan
