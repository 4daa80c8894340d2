#include "raysfm/features/sharpness.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <vector>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "raysfm/features/sharpness.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#ifndef RAYSFM_FEATURES_SHARPNESS_ONCE
#define RAYSFM_FEATURES_SHARPNESS_ONCE
namespace raysfm {
namespace {

constexpr int kEdgeLines = 40;       // of each direction
constexpr int kEdgeLanes = 48;       // lines that are walked side by side, those beyond kEdgeLines level
constexpr int kContrast = 24;        // grey levels: well above the noise of a camera
constexpr size_t kEnoughEdges = 20;  // of each direction
constexpr double kWidthQuantile = 0.25;

// First pixel of each line, and how many there are, `step` bytes apart.
struct EdgeLines {
  const uint8_t* first[kEdgeLines];
  int length;
  ptrdiff_t step;
};

}  // namespace
}  // namespace raysfm
#endif

HWY_BEFORE_NAMESPACE();
namespace raysfm {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

const hn::CappedTag<int16_t, 16> kShorts;

// Monotonous runs of many lines that are walked side by side: most runs are noise and a few pixels long, and
// no branch may depend on where a single one ends.
class EdgeRuns {
 public:
  // Pixels of the lines, kEdgeLanes.
  explicit EdgeRuns(const uint8_t* first) { std::copy_n(first, kEdgeLanes, before_); }

  // To the next pixel of each line. A run goes on where the step has its sign.
  HWY_INLINE void step_to(const uint8_t* next_pixels, std::vector<float>* widths) {
    const hn::Rebind<uint8_t, decltype(kShorts)> bytes;
    const auto zero = hn::Zero(kShorts);
    for (int k = 0; k < kEdgeLanes; k += static_cast<int>(hn::Lanes(kShorts))) {
      const auto next = hn::PromoteTo(kShorts, hn::LoadU(bytes, next_pixels + k));
      const auto slope = hn::Sub(next, hn::Load(kShorts, before_ + k));
      const auto height = hn::Load(kShorts, height_ + k), steepest = hn::Load(kShorts, steepest_ + k);
      const auto level = hn::Or(hn::Eq(slope, zero), hn::Eq(height, zero));
      const auto ends = hn::Or(hn::Lt(hn::Xor(slope, height), zero), level);
      const auto is_edge = hn::And(ends, hn::Gt(hn::Abs(height), hn::Set(kShorts, kContrast - 1)));
      if (!hn::AllFalse(kShorts, is_edge)) collect(k, is_edge, widths);
      const auto restarts = hn::Or(ends, hn::Gt(hn::Abs(slope), hn::Abs(steepest)));
      hn::Store(hn::Add(slope, hn::IfThenZeroElse(ends, height)), kShorts, height_ + k);
      hn::Store(hn::IfThenElse(restarts, slope, steepest), kShorts, steepest_ + k);
      hn::Store(next, kShorts, before_ + k);
    }
  }

 private:
  // Adds the widths of runs. A step of height A blurred by a Gaussian has the slope A / (sigma sqrt(2 pi))
  // where it is steepest.
  template <class M>
  void collect(int k, M is_edge, std::vector<float>* widths) const {
    constexpr float kInverseRoot2Pi = 0.39894228f;
    uint8_t bytes[8] = {};
    hn::StoreMaskBits(kShorts, is_edge, bytes);
    for (unsigned bits = bytes[0] | bytes[1] << 8; bits != 0; bits &= bits - 1) {
      const int i = k + std::countr_zero(bits);
      widths->push_back(kInverseRoot2Pi * static_cast<float>(height_[i]) / static_cast<float>(steepest_[i]));
    }
  }

  alignas(64) int16_t before_[kEdgeLanes] = {};
  alignas(64) int16_t height_[kEdgeLanes] = {}, steepest_[kEdgeLanes] = {};  // of the run up to `before_`
};

// `lines` is a copy, which no store can change, so that the addresses need not be read again.
void collect_widths(const EdgeLines lines, std::vector<float>* widths) {
  // Gathered some steps at a time: a vector that is read right after its bytes were written waits for them.
  constexpr int kAtOnce = 8;
  uint8_t next[kAtOnce][kEdgeLanes] = {};
  const auto look_at = [&](int begin, int count) {
    for (int i = 0; i < count; ++i) {
      const ptrdiff_t offset = (begin + i) * lines.step;
      for (int k = 0; k < kEdgeLines; ++k) next[i][k] = lines.first[k][offset];
    }
  };
  look_at(0, 1);
  EdgeRuns runs(next[0]);
  int count = 1;
  for (int begin = 1; begin < lines.length; begin += kAtOnce) {
    count = std::min(kAtOnce, lines.length - begin);
    look_at(begin, count);
    for (int i = 0; i < count; ++i) runs.step_to(next[i], widths);
  }
  runs.step_to(next[count - 1], widths);  // level: every run ends
}

}  // namespace HWY_NAMESPACE
}  // namespace raysfm
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace raysfm {

HWY_EXPORT(collect_widths);

namespace {

float quantile(std::vector<float>* values) {
  if (values->size() < kEnoughEdges) return 0;
  const auto at =
      values->begin() + static_cast<ptrdiff_t>(kWidthQuantile * static_cast<double>(values->size()));
  std::nth_element(values->begin(), at, values->end());
  return *at;
}

}  // namespace

EdgeWidths edge_widths(const GrayView& image) {
  EdgeLines rows{{}, image.width, 1}, columns{{}, image.height, image.stride};
  for (int k = 0; k < kEdgeLines; ++k) {
    rows.first[k] = image.row((2 * k + 1) * image.height / (2 * kEdgeLines));
    columns.first[k] = image.data + (2 * k + 1) * image.width / (2 * kEdgeLines);
  }
  std::vector<float> across, down;
  HWY_DYNAMIC_DISPATCH(collect_widths)(rows, &across);
  HWY_DYNAMIC_DISPATCH(collect_widths)(columns, &down);
  return {quantile(&across), quantile(&down)};
}

}  // namespace raysfm
#endif  // HWY_ONCE
