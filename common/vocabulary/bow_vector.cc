#include "vocabulary/bow_vector.h"

#include <algorithm>

namespace portolan {
namespace {

/// Calls visit(weight in a, weight in b) for each word of both bags, in order of words.
template <class Visit>
void ForEachCommonWord(const BowVector& a, const BowVector& b, Visit visit) {
  for (auto i = a.begin(), j = b.begin(); i != a.end() && j != b.end();) {
    if (i->first < j->first) {
      ++i;
    } else if (j->first < i->first) {
      ++j;
    } else {
      visit(i++->second, j++->second);
    }
  }
}

}  // namespace

double BowScore(const BowVector& a, const BowVector& b) {
  // For bags of sum 1, 1 - sum |a - b| / 2 is the sum of min(a, b), to which only common words add; an empty bag scores
  // 0.
  double score = 0;
  ForEachCommonWord(a, b, [&](float weight_a, float weight_b) { score += std::min(weight_a, weight_b); });
  return std::min(score, 1.0);
}

int CountCommonWords(const BowVector& a, const BowVector& b) {
  int count = 0;
  ForEachCommonWord(a, b, [&](float, float) { ++count; });
  return count;
}

}  // namespace portolan
