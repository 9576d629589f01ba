#include "base/random.h"

#include <cmath>

#include "base/check.h"

namespace portolan {

uint64_t Random::Next() {
  // Steele, Lea, Flood: Fast splittable pseudorandom number generators, OOPSLA 2014.
  uint64_t z = (state_ += 0x9e3779b97f4a7c15ull);
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ull;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebull;
  return z ^ (z >> 31);
}

uint64_t Random::Below(uint64_t n) {
  __extension__ using Wide = unsigned __int128;
  PORTOLAN_CHECK(n > 0);
  return static_cast<uint64_t>((static_cast<Wide>(Next()) * n) >> 64);
}

double Random::Uniform() {
  return static_cast<double>(Next() >> 11) * 0x1.0p-53;
}

double Random::Gaussian() {
  if (has_spare_) {
    has_spare_ = false;
    return spare_;
  }
  const double radius = std::sqrt(-2.0 * std::log(1.0 - Uniform()));
  const double angle = 2.0 * M_PI * Uniform();
  spare_ = radius * std::sin(angle);
  has_spare_ = true;
  return radius * std::cos(angle);
}

}  // namespace portolan
