#pragma once

#include <vector>

#include "base/random.h"
#include "features/feature_set.h"

namespace portolan {

inline Descriptor RandomDescriptor(Random* random) {
  return {random->Next(), random->Next(), random->Next(), random->Next()};
}

/// The descriptor with each bit flipped with the given probability.
inline Descriptor WithNoise(Descriptor descriptor, double probability, Random* random) {
  for (uint64_t& word : descriptor) {
    for (int bit = 0; bit < 64; ++bit) word ^= uint64_t{random->Uniform() < probability} << bit;
  }
  return descriptor;
}

/// Images that show the same 300 things, each a descriptor with noise, a random third of them in each image.
inline std::vector<std::vector<Descriptor>> RandomImages(int count, uint64_t seed) {
  Random random(seed);
  std::vector<Descriptor> things;
  for (int i = 0; i < 300; ++i) things.push_back(RandomDescriptor(&random));
  std::vector<std::vector<Descriptor>> images(static_cast<size_t>(count));
  for (std::vector<Descriptor>& image : images) {
    for (const Descriptor& thing : things) {
      if (random.Below(3) == 0) image.push_back(WithNoise(thing, 0.03, &random));
    }
  }
  return images;
}

}  // namespace portolan
