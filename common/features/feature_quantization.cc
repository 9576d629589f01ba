#include "features/feature_quantization.h"

#include <algorithm>
#include <cmath>

#include "base/check.h"

namespace portolan {
namespace {

constexpr int kFinestStepsPerPixel = 32;
constexpr int kLargestSteps = 65535;
constexpr double kAngleSteps = 65536.0;
constexpr double kTwoPi = 2.0 * M_PI;

}  // namespace

int StepsPerPixel(const PinholeCamera& camera) {
  const int side = std::max(camera.width, camera.height);
  int steps = kFinestStepsPerPixel;
  while (steps > 1 && (side - 1) * steps > kLargestSteps) steps /= 2;
  return steps;
}

uint16_t PixelToSteps(float coordinate_px, int steps_per_pixel) {
  const double steps = std::round(static_cast<double>(coordinate_px) * steps_per_pixel);
  PORTOLAN_CHECK(steps >= 0 && steps <= kLargestSteps)
      << "coordinate " << coordinate_px << " px with " << steps_per_pixel
      << " steps to the pixel does not fit the wire";
  return static_cast<uint16_t>(steps);
}

float StepsToPixel(uint16_t steps, int steps_per_pixel) {
  return static_cast<float>(steps) / static_cast<float>(steps_per_pixel);
}

uint16_t AngleToSteps(float angle_rad) {
  PORTOLAN_CHECK(std::isfinite(angle_rad)) << "angle " << angle_rad;
  const double turns = static_cast<double>(angle_rad) / kTwoPi;
  const double steps = std::round((turns - std::floor(turns)) * kAngleSteps);
  return static_cast<uint16_t>(static_cast<uint32_t>(steps) & 0xffffu);  // a full turn is step 0
}

float StepsToAngle(uint16_t steps) {
  return static_cast<float>(steps * (kTwoPi / kAngleSteps));
}

void QuantizeFeatures(FeatureSet* features, const PinholeCamera& camera) {
  const int steps_per_pixel = StepsPerPixel(camera);
  for (Eigen::Vector2f& pixel_px : features->pixels_px) {
    pixel_px = Eigen::Vector2f(StepsToPixel(PixelToSteps(pixel_px.x(), steps_per_pixel), steps_per_pixel),
                               StepsToPixel(PixelToSteps(pixel_px.y(), steps_per_pixel), steps_per_pixel));
  }
  for (float& angle_rad : features->angles_rad) angle_rad = StepsToAngle(AngleToSteps(angle_rad));
}

}  // namespace portolan
