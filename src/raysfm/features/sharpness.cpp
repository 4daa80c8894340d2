#include "raysfm/features/sharpness.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <vector>

namespace raysfm {
namespace {

constexpr int kLines = 40;      // of each direction
constexpr int kContrast = 24;   // grey levels: well above the noise of a camera
constexpr size_t kEnough = 20;  // edges of each direction
constexpr double kQuantile = 0.25;

// Widths of the monotonous runs of a line. A step of height A blurred by a Gaussian has the slope
// A / (sigma sqrt(2 pi)) where it is steepest.
void collect_widths(const uint8_t* line, int count, ptrdiff_t step, std::vector<float>* widths) {
  constexpr float kInverseRoot2Pi = 0.39894228f;
  int height = 0, steepest = 0;
  const auto close = [&] {
    if (std::abs(height) >= kContrast) {
      widths->push_back(kInverseRoot2Pi * static_cast<float>(height) / static_cast<float>(steepest));
    }
  };
  for (int i = 1; i < count; ++i) {
    const int d = line[i * step] - line[(i - 1) * step];
    if ((d > 0) != (height > 0) || d == 0) {
      close();
      height = steepest = 0;
    }
    height += d;
    if (std::abs(d) > std::abs(steepest)) steepest = d;
  }
  close();
}

float quantile(std::vector<float>* values) {
  if (values->size() < kEnough) return 0;
  const auto at = values->begin() + static_cast<ptrdiff_t>(kQuantile * static_cast<double>(values->size()));
  std::nth_element(values->begin(), at, values->end());
  return *at;
}

}  // namespace

float edge_width(const GrayView& image) {
  std::vector<float> across, down;
  for (int k = 0; k < kLines; ++k) {
    const int y = (2 * k + 1) * image.height / (2 * kLines), x = (2 * k + 1) * image.width / (2 * kLines);
    collect_widths(image.row(y), image.width, 1, &across);
    collect_widths(image.data + x, image.height, image.stride, &down);
  }
  const float u = quantile(&across), v = quantile(&down);
  // A picture of stripes tells one direction only.
  return u > 0 && v > 0 ? std::sqrt(u * v) : std::max(u, v);
}

}  // namespace raysfm
