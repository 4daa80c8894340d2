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
// Rows of a template are padded with zeros to this many floats. Sums run over each of these columns on its
// own and then over the columns in a fixed order, so that they do not depend on the length of the vectors.
constexpr int kRow = 16;
constexpr int kArea = kSide * kRow;

// Least eigenvalue of the normal matrix: with noise of 2 grey levels, sigma = 2 / sqrt(50) = 0.28 pixels.
constexpr float kMinCurvature = 50.0f;

const hn::CappedTag<float, kRow> kFloats;

// A patch of the reference. The gradients that count are those less their parts along the constant and along
// the patch itself, which bias and gain would explain: g - mean(g) - (g . v / v . v) v with v the patch less
// its mean. Only sums with them are needed, so they are never written down.
struct Template {
  alignas(64) float value[kArea];  // grey levels
  alignas(64) float dx[kArea];     // central differences
  alignas(64) float dy[kArea];
  float mean, mean_dx, mean_dy;
  float along_dx, along_dy;  // g . v / v . v
  float norm2;               // v . v
  float hxx, hxy, hyy;       // inverse of the normal matrix
};

// One inside the patch, zero in the padding.
struct Inside {
  constexpr Inside() {
    for (int c = 0; c < kSide; ++c) value[c] = 1.0f;
  }
  alignas(64) float value[kRow] = {};
};
static constexpr Inside kInside;

// Pairwise, in an order that does not depend on the instruction set. `columns` is aligned to 64 bytes.
HWY_INLINE float sum_columns(const float* HWY_RESTRICT columns) {
  const hn::CappedTag<float, 8> d8;
  const hn::CappedTag<float, 4> d4;
  alignas(32) float a[8], b[4];
  for (int i = 0; i < 8; i += static_cast<int>(hn::Lanes(d8))) {
    hn::Store(hn::Add(hn::Load(d8, columns + i), hn::Load(d8, columns + i + 8)), d8, a + i);
  }
  for (int i = 0; i < 4; i += static_cast<int>(hn::Lanes(d4))) {
    hn::Store(hn::Add(hn::Load(d4, a + i), hn::Load(d4, a + i + 4)), d4, b + i);
  }
  return (b[0] + b[2]) + (b[1] + b[3]);
}

template <int kCount>
struct ColumnSums {
  alignas(64) float columns[kCount][kRow] = {};
  template <class V>
  HWY_INLINE void store(int i, int column, V v) {
    hn::Store(v, kFloats, columns[i] + column);
  }
  HWY_INLINE float operator[](int i) const { return sum_columns(columns[i]); }
};

// Sums over a patch: of values t and gradients x, y, and of their products.
struct TemplateSums {
  float t, x, y, tt, tx, ty, xx, xy, yy;
};

// Values and central differences of a patch that is sampled with a rim of one pixel.
HWY_INLINE TemplateSums load_template(const GrayView& reference, const AffineWindow& window, Template* out) {
  constexpr int kWide = kSide + 2;
  alignas(64) int32_t samples[PatchOffsets<kRadius + 1>::kPadded];
  sample_affine<kRadius + 1>(reference, window, samples);

  const hn::RebindToSigned<decltype(kFloats)> ints;
  constexpr float kScale = 1.0f / (1 << (2 * kWeightBits));
  ColumnSums<9> sums;
  for (int c = 0; c < kSide; c += static_cast<int>(hn::Lanes(kFloats))) {
    const auto inside = hn::Load(kFloats, kInside.value + c);
    const auto scale = hn::Mul(inside, hn::Set(kFloats, kScale));
    const auto half_scale = hn::Mul(inside, hn::Set(kFloats, 0.5f * kScale));
    const auto zero = hn::Zero(kFloats);
    auto st = zero, sx = zero, sy = zero, stt = zero, stx = zero, sty = zero, sxx = zero, sxy = zero,
         syy = zero;
    for (int r = 0; r < kSide; ++r) {
      const int32_t* s = samples + (r + 1) * kWide + 1 + c;
      const auto difference = [&](int step) HWY_ATTR {
        return hn::ConvertTo(kFloats, hn::Sub(hn::LoadU(ints, s + step), hn::LoadU(ints, s - step)));
      };
      const auto t = hn::Mul(scale, hn::ConvertTo(kFloats, hn::LoadU(ints, s)));
      const auto x = hn::Mul(half_scale, difference(1)), y = hn::Mul(half_scale, difference(kWide));
      hn::Store(t, kFloats, out->value + r * kRow + c);
      hn::Store(x, kFloats, out->dx + r * kRow + c);
      hn::Store(y, kFloats, out->dy + r * kRow + c);
      st = hn::Add(st, t), sx = hn::Add(sx, x), sy = hn::Add(sy, y);
      stt = hn::Add(stt, hn::Mul(t, t)), stx = hn::Add(stx, hn::Mul(t, x)), sty = hn::Add(sty, hn::Mul(t, y));
      sxx = hn::Add(sxx, hn::Mul(x, x)), sxy = hn::Add(sxy, hn::Mul(x, y)), syy = hn::Add(syy, hn::Mul(y, y));
    }
    sums.store(0, c, st), sums.store(1, c, sx), sums.store(2, c, sy);
    sums.store(3, c, stt), sums.store(4, c, stx), sums.store(5, c, sty);
    sums.store(6, c, sxx), sums.store(7, c, sxy), sums.store(8, c, syy);
  }
  return {sums[0], sums[1], sums[2], sums[3], sums[4], sums[5], sums[6], sums[7], sums[8]};
}

// False where the patch does not fix both coordinates.
HWY_INLINE bool make_template(const GrayView& reference, const AffineWindow& window, Template* t) {
  const TemplateSums s = load_template(reference, window, t);
  t->mean = s.t / kCount;
  t->mean_dx = s.x / kCount;
  t->mean_dy = s.y / kCount;
  t->norm2 = s.tt - s.t * t->mean;
  if (!(t->norm2 > kCount)) return false;  // a standard deviation of one grey level
  const float tx = s.tx - s.t * t->mean_dx, ty = s.ty - s.t * t->mean_dy;
  t->along_dx = tx / t->norm2;
  t->along_dy = ty / t->norm2;
  const float xx = s.xx - s.x * t->mean_dx - tx * t->along_dx;
  const float xy = s.xy - s.x * t->mean_dy - tx * t->along_dy;
  const float yy = s.yy - s.y * t->mean_dy - ty * t->along_dy;
  const float least = 0.5f * (xx + yy - std::sqrt((xx - yy) * (xx - yy) + 4 * xy * xy));
  if (!(least > kMinCurvature)) return false;
  const float det = xx * yy - xy * xy;
  t->hxx = yy / det;
  t->hxy = -xy / det;
  t->hyy = xx / det;
  return true;
}

// Products of a sample with the parts of a template that count, and its variance times kCount.
struct Correlation {
  float dx, dy, value, variance;
};

// With the patch of the target that begins at `block`, moved by (fx, fy) in [0, 1).
HWY_INLINE Correlation correlate(const Template& t, const PixelBlock& block, float fx, float fy) {
  const hn::Rebind<uint8_t, decltype(kFloats)> bytes;
  const hn::RebindToSigned<decltype(kFloats)> ints;
  const auto wx = hn::Set(kFloats, fx), wy = hn::Set(kFloats, fy);
  const auto load = [&](const uint8_t* p)
                        HWY_ATTR { return hn::ConvertTo(kFloats, hn::PromoteTo(ints, hn::LoadU(bytes, p))); };
  const auto blend_row = [&](const uint8_t* p) HWY_ATTR {
    const auto left = load(p);
    return hn::Add(left, hn::Mul(wx, hn::Sub(load(p + 1), left)));
  };
  ColumnSums<5> sums;
  for (int c = 0; c < kSide; c += static_cast<int>(hn::Lanes(kFloats))) {
    auto dx = hn::Zero(kFloats), dy = hn::Zero(kFloats), value = hn::Zero(kFloats);
    auto one = hn::Zero(kFloats), square = hn::Zero(kFloats);
    const auto inside = hn::Load(kFloats, kInside.value + c);
    auto above = blend_row(block.data + c);
    for (int r = 0; r < kSide; ++r) {
      const auto below = blend_row(block.data + (r + 1) * block.stride + c);
      const auto sample = hn::Mul(inside, hn::Add(above, hn::Mul(wy, hn::Sub(below, above))));
      const int i = r * kRow + c;
      dx = hn::Add(dx, hn::Mul(sample, hn::Load(kFloats, t.dx + i)));
      dy = hn::Add(dy, hn::Mul(sample, hn::Load(kFloats, t.dy + i)));
      value = hn::Add(value, hn::Mul(sample, hn::Load(kFloats, t.value + i)));
      one = hn::Add(one, sample);
      square = hn::Add(square, hn::Mul(sample, sample));
      above = below;
    }
    sums.store(0, c, dx), sums.store(1, c, dy), sums.store(2, c, value);
    sums.store(3, c, one), sums.store(4, c, square);
  }
  const float one = sums[3], value = sums[2] - t.mean * one;
  return {sums[0] - t.mean_dx * one - t.along_dx * value, sums[1] - t.mean_dy * one - t.along_dy * value,
          value, sums[4] - one * one / kCount};
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
    const float gain = s.value / t.norm2;
    if (!(gain > 0 && s.variance > 0)) return result;
    result.zncc = std::min(1.0f, s.value / std::sqrt(t.norm2 * s.variance));
    const Eigen::Vector2f step(-(t.hxx * s.dx + t.hxy * s.dy) / gain, -(t.hxy * s.dx + t.hyy * s.dy) / gain);
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
