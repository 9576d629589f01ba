#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "base/result.h"
#include "features/feature_set.h"
#include "vocabulary/vocabulary.h"

namespace portolan {

struct VocabularyTrainingOptions {
  int branching = 10;  ///< children a node, k
  int depth = 5;       ///< levels, L: up to k^L words
  uint64_t seed = 1;
  int max_iterations = 30;  ///< of k-medians at a node; most end sooner, when no descriptor changes its cluster

  Status Check() const;  ///< ranges of each field; the message names the key
};

/// Called with the share of the work that is done, 0 to 1, rising.
using TrainingProgress = std::function<void(double)>;

/// Builds a vocabulary tree: hierarchical k-medians over binary descriptors, seeded as k-means++, words weighted by
/// their inverse document frequency ln(N / n_i). Source: Galvez-Lopez and Tardos, Bags of binary words, TRO 2012, Sec.
/// III; Arthur and Vassilvitskii, k-means++, SODA 2007.
/// @param images descriptors of each training image. @param progress may be null.
/// Fails on too few descriptors for a tree. Deterministic for a given options.seed.
Result<std::shared_ptr<const Vocabulary>> TrainVocabulary(const std::vector<std::vector<Descriptor>>& images,
                                                          const VocabularyTrainingOptions& options,
                                                          const TrainingProgress& progress);

}  // namespace portolan
