#pragma once

#include <cstdint>
#include <utility>
#include <vector>

namespace portolan {

/// An image as a bag of visual words: (word, tf-idf weight), sorted by word, weights summing to 1 (L1). May be empty.
using BowVector = std::vector<std::pair<uint32_t, float>>;

/// Similarity of two L1-normalised bags, 0 to 1: 1 - |a - b|_1 / 2.
/// Source: Galvez-Lopez and Tardos, Bags of binary words, TRO 2012, Eq. (2).
double BowScore(const BowVector& a, const BowVector& b);

/// Number of words that both bags have.
int CountCommonWords(const BowVector& a, const BowVector& b);

}  // namespace portolan
