#include "testing/sensor.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "base/random.h"

namespace portolan {
namespace {

constexpr size_t kNoiseTableSize = 1 << 16;

/// Gaussian numbers drawn once: drawing one for each pixel would take longer than rendering the picture.
const std::vector<float>& NoiseTable() {
  static const std::vector<float> table = [] {
    Random random(0x5eed);
    std::vector<float> numbers(kNoiseTableSize);
    for (float& number : numbers) number = static_cast<float>(random.Gaussian());
    return numbers;
  }();
  return table;
}

}  // namespace

Status SensorOptions::Check() const {
  if (!(noise_sigma >= 0 && noise_sigma <= 100))
    return Error{"noise_sigma: " + std::to_string(noise_sigma) + ", expected 0 to 100 grey levels"};
  if (!(exposure_change >= 0 && exposure_change < 1)) {
    return Error{"exposure_change: " + std::to_string(exposure_change) + ", expected 0 to 1"};
  }
  if (!(exposure_s >= 0 && exposure_s <= 1))
    return Error{"exposure_s: " + std::to_string(exposure_s) + ", expected 0 to 1 s"};
  return Ok{};
}

cv::Mat Expose(const cv::Mat& light, double stamp_s, uint64_t seed, const SensorOptions& options) {
  constexpr double kExposurePeriod = 9.0;  // s, of the slow change of brightness
  const float gain = static_cast<float>(1.0 + options.exposure_change * std::sin(2 * M_PI * stamp_s / kExposurePeriod));
  const float sigma = static_cast<float>(options.noise_sigma);
  const std::vector<float>& noise = NoiseTable();
  Random random(seed);
  cv::Mat picture(light.size(), CV_8UC1);
  for (int y = 0; y < light.rows; ++y) {
    const float* in = light.ptr<float>(y);
    uint8_t* out = picture.ptr<uint8_t>(y);
    // Each row reads the table from a place and with an odd stride of its own.
    size_t at = random.Below(kNoiseTableSize);
    const size_t stride = 2 * random.Below(kNoiseTableSize / 2) + 1;
    for (int x = 0; x < light.cols; ++x) {
      at = (at + stride) & (kNoiseTableSize - 1);
      out[x] = static_cast<uint8_t>(std::clamp(gain * in[x] + sigma * noise[at] + 0.5f, 0.0f, 255.0f));
    }
  }
  return picture;
}

}  // namespace portolan
