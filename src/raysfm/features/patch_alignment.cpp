#include "raysfm/features/patch_alignment.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "raysfm/features/patch_window.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "raysfm/features/patch_alignment.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include "raysfm/features/patch_sampling-inl.h"

HWY_BEFORE_NAMESPACE();
namespace raysfm {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

constexpr int kRadius = 5;
constexpr int kSide = 2 * kRadius + 1;
constexpr int kCount = kSide * kSide;
constexpr int kRow = 16;  // rows of a template are padded with zeros to this many numbers
constexpr int kArea = kSide * kRow;

// Grey levels less 128 and gradients are whole numbers, in units of a 32nd: at most 2^12, so that the sum of
// the products of two patches fits 32 bits. Sums are exact, whatever the length of the vectors.
constexpr int kUnits = 32, kMiddle = 128 * kUnits;
// Least eigenvalue of the normal matrix: with noise of 2 grey levels, sigma = 2 / sqrt(50) = 0.28 pixels.
constexpr double kMinCurvature = 50.0 * kUnits * kUnits;
constexpr double kMinNorm2 = double{kCount} * kUnits * kUnits;  // a standard deviation of one grey level

const hn::CappedTag<int16_t, kRow> kShorts;
#if HWY_TARGET == HWY_SCALAR
const hn::Rebind<int32_t, decltype(kShorts)> kSums;
#else
const hn::RepartitionToWide<decltype(kShorts)> kSums;
#endif

// A patch of the reference. The gradients that count are those less their parts along the constant and along
// the patch itself, which bias and gain would explain: g - mean(g) - (g . v / v . v) v with v the patch less
// its mean. Only sums with them are needed, so they are never written down.
struct Template {
  alignas(64) int16_t value[kArea];
  alignas(64) int16_t dx[kArea];  // central differences
  alignas(64) int16_t dy[kArea];
  double mean, mean_dx, mean_dy;
  double along_dx, along_dy;  // g . v / v . v
  double norm2;               // v . v
  double hxx, hxy, hyy;       // inverse of the normal matrix
};

// All bits inside the patch, none in the padding.
struct Inside {
  constexpr Inside() {
    for (int c = 0; c < kSide; ++c) bits[c] = -1;
  }
  alignas(64) int16_t bits[kRow] = {};
};
static constexpr Inside kInside;

// Sum of products.
struct Dot {
  using V = hn::Vec<decltype(kSums)>;
  V even, odd;
  template <class Shorts>
  HWY_INLINE void add(Shorts a, Shorts b) {
    even = hn::ReorderWidenMulAccumulate(kSums, a, b, even, odd);
  }
  HWY_INLINE double sum() const { return hn::GetLane(hn::SumOfLanes(kSums, hn::Add(even, odd))); }
};

HWY_INLINE Dot empty_dot() {
  return {hn::Zero(kSums), hn::Zero(kSums)};
}

// Sums over a patch: of values t and gradients x, y, and of their products.
struct TemplateSums {
  double t, x, y, tt, tx, ty, xx, xy, yy;
};

// Values and central differences of a patch that is sampled with a rim of one pixel.
HWY_INLINE TemplateSums load_template(const GrayView& reference, const AffineWindow& window, Template* out) {
  constexpr int kWide = kSide + 2;
  static_assert((1 << kLevelBits) == 2 * kUnits);
  alignas(64) int16_t samples[PatchOffsets<kRadius + 1>::kPadded];
  sample_affine<kRadius + 1>(reference, window, samples);

  const auto one = hn::Set(kShorts, 1), two = hn::Set(kShorts, 2), middle = hn::Set(kShorts, kMiddle);
  Dot t = empty_dot(), x = t, y = t, tt = t, tx = t, ty = t, xx = t, xy = t, yy = t;
  for (int c = 0; c < kSide; c += static_cast<int>(hn::Lanes(kShorts))) {
    const auto inside = hn::Load(kShorts, kInside.bits + c);
    for (int r = 0; r < kSide; ++r) {
      const int16_t* s = samples + (r + 1) * kWide + 1 + c;
      const auto load = [s](int step) HWY_ATTR { return hn::LoadU(kShorts, s + step); };
      const auto gradient = [&](int step) HWY_ATTR {
        return hn::And(inside, hn::ShiftRight<2>(hn::Add(hn::Sub(load(step), load(-step)), two)));
      };
      const auto value = hn::And(inside, hn::Sub(hn::ShiftRight<1>(hn::Add(load(0), one)), middle));
      const auto dx = gradient(1), dy = gradient(kWide);
      hn::Store(value, kShorts, out->value + r * kRow + c);
      hn::Store(dx, kShorts, out->dx + r * kRow + c);
      hn::Store(dy, kShorts, out->dy + r * kRow + c);
      t.add(value, one), x.add(dx, one), y.add(dy, one);
      tt.add(value, value), tx.add(value, dx), ty.add(value, dy);
      xx.add(dx, dx), xy.add(dx, dy), yy.add(dy, dy);
    }
  }
  return {t.sum(), x.sum(), y.sum(), tt.sum(), tx.sum(), ty.sum(), xx.sum(), xy.sum(), yy.sum()};
}

// False where the patch does not fix both coordinates.
HWY_INLINE bool make_template(const GrayView& reference, const AffineWindow& window, Template* t) {
  const TemplateSums s = load_template(reference, window, t);
  t->mean = s.t / kCount;
  t->mean_dx = s.x / kCount;
  t->mean_dy = s.y / kCount;
  t->norm2 = s.tt - s.t * t->mean;
  if (!(t->norm2 > kMinNorm2)) return false;
  const double tx = s.tx - s.t * t->mean_dx, ty = s.ty - s.t * t->mean_dy;
  t->along_dx = tx / t->norm2;
  t->along_dy = ty / t->norm2;
  const double xx = s.xx - s.x * t->mean_dx - tx * t->along_dx;
  const double xy = s.xy - s.x * t->mean_dy - tx * t->along_dy;
  const double yy = s.yy - s.y * t->mean_dy - ty * t->along_dy;
  const double least = 0.5 * (xx + yy - std::sqrt((xx - yy) * (xx - yy) + 4 * xy * xy));
  if (!(least > kMinCurvature)) return false;
  const double det = xx * yy - xy * xy;
  t->hxx = yy / det;
  t->hxy = -xy / det;
  t->hyy = xx / det;
  return true;
}

// Products of a sample with the parts of a template that count, and its variance times kCount.
struct Correlation {
  double dx, dy, value, variance;
};

// With the patch of the target that begins at `block`, moved by (fx, fy) in [0, 1).
HWY_INLINE Correlation correlate(const Template& t, const PixelBlock& block, float fx, float fy) {
  const hn::Rebind<uint8_t, decltype(kShorts)> bytes;
  const auto weight = [](float f) HWY_ATTR {
    constexpr float kOne = 32768;
    return hn::Set(kShorts, static_cast<int16_t>(std::min(f * kOne + 0.5f, kOne - 1)));
  };
  const auto wx = weight(fx), wy = weight(fy);
  const auto one = hn::Set(kShorts, 1), middle = hn::Set(kShorts, kMiddle);
  const auto load = [&](const uint8_t* p) HWY_ATTR {
    constexpr int kUnitBits = 5;
    static_assert(1 << kUnitBits == kUnits);
    return hn::ShiftLeft<kUnitBits>(hn::PromoteTo(kShorts, hn::LoadU(bytes, p)));
  };
  const auto blend_row = [&](const uint8_t* p) HWY_ATTR {
    const auto left = load(p);
    return hn::Add(hn::Sub(left, middle), hn::MulFixedPoint15(hn::Sub(load(p + 1), left), wx));
  };
  Dot dx = empty_dot(), dy = dx, value = dx, sum = dx, square = dx;
  for (int c = 0; c < kSide; c += static_cast<int>(hn::Lanes(kShorts))) {
    const auto inside = hn::Load(kShorts, kInside.bits + c);
    auto above = blend_row(block.data + c);
    for (int r = 0; r < kSide; ++r) {
      const auto below = blend_row(block.data + (r + 1) * block.stride + c);
      const auto sample = hn::And(inside, hn::Add(above, hn::MulFixedPoint15(hn::Sub(below, above), wy)));
      const int i = r * kRow + c;
      dx.add(sample, hn::Load(kShorts, t.dx + i));
      dy.add(sample, hn::Load(kShorts, t.dy + i));
      value.add(sample, hn::Load(kShorts, t.value + i));
      sum.add(sample, one);
      square.add(sample, sample);
      above = below;
    }
  }
  const double s = sum.sum(), along = value.sum() - t.mean * s;
  return {dx.sum() - t.mean_dx * s - t.along_dx * along, dy.sum() - t.mean_dy * s - t.along_dy * along, along,
          square.sum() - s * s / kCount};
}

// Steps shrink by about the same factor each time: the sum of those to come, and how long the next one would
// be, are told by two. Nothing is made of factors that are no convergence.
struct Outlook {
  Eigen::Vector2f rest = Eigen::Vector2f::Zero();
  float next2 = std::numeric_limits<float>::infinity();  // squared length
};
HWY_INLINE Outlook look_ahead(const Eigen::Vector2f& before, const Eigen::Vector2f& step) {
  constexpr float kMaxFactor = 0.6f;
  const float factor = before.dot(step) / before.squaredNorm();
  if (!(std::abs(factor) < kMaxFactor)) return {};
  return {factor / (1 - factor) * step, factor * factor * step.squaredNorm()};
}

HWY_INLINE bool inside(const GrayView& target, float u, float v) {
  return u >= kRadius && v >= kRadius && u < static_cast<float>(target.width - kRadius - 1) &&
         v < static_cast<float>(target.height - kRadius - 1);
}

PatchAlignment align_patch(const GrayView& reference, const AffineWindow& window, const GrayView& target,
                           const Eigen::Vector2f& initial, const PatchAlignmentOptions& options) {
  PatchAlignment result{initial, 0, false};
  Template t;
  if (!inside(target, std::floor(initial.x()), std::floor(initial.y()))) return result;
  if (!make_template(reference, window, &t)) return result;
  BlockBuffer<kSide + 1> buffer;
  Eigen::Vector2f p = initial, before = Eigen::Vector2f::Zero();
  const float stop2 = options.stop_px * options.stop_px;
  for (int iteration = 0; iteration < options.max_iterations; ++iteration) {
    const float u = std::floor(p.x()), v = std::floor(p.y());
    if (!inside(target, u, v)) return result;
    const PixelBlock block = readable_block<kSide + 1>(target, static_cast<int>(u) - kRadius,
                                                       static_cast<int>(v) - kRadius, kSide + 1, &buffer);
    const Correlation s = correlate(t, block, p.x() - u, p.y() - v);
    // The sample is gain * template + bias, moved; a dark copy (negative gain) is another patch.
    const double gain = s.value / t.norm2;
    if (!(gain > 0 && s.variance > 0)) return result;
    result.zncc = static_cast<float>(std::min(1.0, s.value / std::sqrt(t.norm2 * s.variance)));
    const Eigen::Vector2f step =
        Eigen::Vector2d(-(t.hxx * s.dx + t.hxy * s.dy) / gain, -(t.hxy * s.dx + t.hyy * s.dy) / gain)
            .cast<float>();
    // Every second step: the one after a leap is no continuation of the one before.
    const Outlook outlook = iteration % 2 == 1 ? look_ahead(before, step) : Outlook{};
    before = step;
    p += step + outlook.rest;
    if (!((p - initial).squaredNorm() <= options.max_shift_px * options.max_shift_px)) return result;
    if (step.squaredNorm() > stop2 && outlook.next2 > stop2) continue;
    if (result.zncc < options.min_zncc) return result;
    result.pixel = p;
    result.converged = true;
    return result;
  }
  return result;
}

}  // namespace HWY_NAMESPACE
}  // namespace raysfm
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace raysfm {

HWY_EXPORT(align_patch);

namespace {
constexpr int kAlignmentReach = 6;  // of the template, with its rim for the gradients
}  // namespace

void PatchAligner::align(const GrayView& reference, std::span<const Eigen::Vector2f> reference_pixels,
                         std::span<const Eigen::Matrix2f> reference_from_target, const GrayView& target,
                         std::span<const Eigen::Vector2f> initial, std::span<PatchAlignment> out) const {
  for (size_t i = 0; i < out.size(); ++i) {
    const auto window =
        affine_window(reference, reference_pixels[i], reference_from_target[i], kAlignmentReach);
    out[i] = window ? HWY_DYNAMIC_DISPATCH(align_patch)(reference, *window, target, initial[i], options_)
                    : PatchAlignment{initial[i], 0, false};
  }
}

}  // namespace raysfm
#endif  // HWY_ONCE
