#include "raysfm/features/sharpness.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

namespace raysfm {
namespace {

constexpr int kLines = 40;      // of each direction
constexpr int kContrast = 24;   // grey levels: well above the noise of a camera
constexpr size_t kEnough = 20;  // edges of each direction
constexpr double kQuantile = 0.25;

// Monotonous runs of many lines that are walked side by side: most runs are noise and a few pixels long, and
// no branch may depend on where a single one ends.
class Runs {
 public:
  using Lines = std::array<const uint8_t*, kLines>;
  explicit Runs(const Lines& lines) : lines_(lines) {
    for (int k = 0; k < kLines; ++k) before_[k] = lines[k][0];
  }

  void step_to(ptrdiff_t offset) {
    for (int k = 0; k < kLines; ++k) {
      const int16_t value = lines_[k][offset];
      slope_[k] = static_cast<int16_t>(value - before_[k]);
      before_[k] = value;
    }
  }
  void step_out() { slope_.fill(0); }

  // Adds the widths of the runs that end before the step. A step of height A blurred by a Gaussian has the
  // slope A / (sigma sqrt(2 pi)) where it is steepest.
  void collect(std::vector<float>* widths) const {
    constexpr float kInverseRoot2Pi = 0.39894228f;
    std::array<int16_t, kLines> ends;
    int16_t any = 0;
    for (int k = 0; k < kLines; ++k) {
      const bool is_edge = (height_[k] >= kContrast) | (height_[k] <= -kContrast);
      ends[k] = is_edge & !goes_on(k) ? -1 : 0;
      any |= ends[k];
    }
    for (int k = 0; k < kLines && any != 0; ++k) {
      if (ends[k] == 0) continue;
      widths->push_back(kInverseRoot2Pi * static_cast<float>(height_[k]) / static_cast<float>(steepest_[k]));
    }
  }

  void take_step() {
    for (int k = 0; k < kLines; ++k) {
      const int16_t d = slope_[k], s = steepest_[k];
      const int16_t on = goes_on(k) ? -1 : 0;
      const int16_t steeper = ((d > s) & (d > -s)) | ((d < s) & (d < -s)) ? -1 : 0;
      const auto keeps = static_cast<int16_t>(on & ~steeper);
      height_[k] = static_cast<int16_t>((height_[k] & on) + d);
      steepest_[k] = static_cast<int16_t>((s & keeps) | (d & ~keeps));
    }
  }

 private:
  bool goes_on(int k) const {
    const int16_t h = height_[k], d = slope_[k];
    return ((d > 0) & (h > 0)) | ((d < 0) & (h < 0));
  }

  Lines lines_;
  std::array<int16_t, kLines> before_{}, slope_{};     // pixel, and the step from it to the next
  std::array<int16_t, kLines> height_{}, steepest_{};  // of the run up to that pixel
};

void collect_widths(const Runs::Lines& lines, int count, ptrdiff_t step, std::vector<float>* widths) {
  Runs runs(lines);
  for (int i = 1; i < count; ++i) {
    runs.step_to(i * step);
    runs.collect(widths);
    runs.take_step();
  }
  runs.step_out();
  runs.collect(widths);
}

float quantile(std::vector<float>* values) {
  if (values->size() < kEnough) return 0;
  const auto at = values->begin() + static_cast<ptrdiff_t>(kQuantile * static_cast<double>(values->size()));
  std::nth_element(values->begin(), at, values->end());
  return *at;
}

}  // namespace

float edge_width(const GrayView& image) {
  Runs::Lines rows, columns;
  for (int k = 0; k < kLines; ++k) {
    rows[k] = image.row((2 * k + 1) * image.height / (2 * kLines));
    columns[k] = image.data + (2 * k + 1) * image.width / (2 * kLines);
  }
  std::vector<float> across, down;
  collect_widths(rows, image.width, 1, &across);
  collect_widths(columns, image.height, image.stride, &down);
  const float u = quantile(&across), v = quantile(&down);
  // A picture of stripes tells one direction only.
  return u > 0 && v > 0 ? std::sqrt(u * v) : std::max(u, v);
}

}  // namespace raysfm
