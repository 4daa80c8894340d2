#include "raysfm/features/patch_alignment.h"

#include <algorithm>
#include <cmath>

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

struct Template {
  alignas(64) float value[kArea];  // grey levels less their mean
  alignas(64) float dx[kArea];     // gradient less its parts along the constant and along `value`
  alignas(64) float dy[kArea];
  float norm2;          // of value
  float hxx, hxy, hyy;  // inverse of the normal matrix
};

struct Sums {
  float dx, dy, value;  // products of the sample with the template
  float one, square;    // of the sample
};

// Pairwise, in an order that does not depend on the instruction set.
HWY_INLINE float sum_columns(float* columns) {
  for (int width = kRow / 2; width > 0; width /= 2) {
    for (int i = 0; i < width; ++i) columns[i] += columns[i + width];
  }
  return columns[0];
}

HWY_INLINE float dot(const float* HWY_RESTRICT a, const float* HWY_RESTRICT b) {
  alignas(64) float columns[kRow] = {};
  for (int c = 0; c < kSide; c += static_cast<int>(hn::Lanes(kFloats))) {
    auto sum = hn::Zero(kFloats);
    for (int i = c; i < kArea; i += kRow) {
      sum = hn::Add(sum, hn::Mul(hn::Load(kFloats, a + i), hn::Load(kFloats, b + i)));
    }
    hn::Store(sum, kFloats, columns + c);
  }
  return sum_columns(columns);
}

// a <- a - factor * b
HWY_INLINE void subtract(float* HWY_RESTRICT a, float factor, const float* HWY_RESTRICT b) {
  for (int i = 0; i < kArea; ++i) a[i] -= factor * b[i];
}

// One inside the patch, zero in the padding.
struct Inside {
  constexpr Inside() {
    for (int i = 0; i < kArea; ++i) value[i] = i % kRow < kSide ? 1.0f : 0.0f;
  }
  alignas(64) float value[kArea] = {};
};
static constexpr Inside kInside;

// Values and central differences of a patch that is sampled with a rim of one pixel.
HWY_INLINE void load_template(const GrayView& reference, const AffineWindow& window, Template* t) {
  constexpr int kWide = kSide + 2;
  alignas(64) int32_t samples[PatchOffsets<kRadius + 1>::kPadded];
  sample_affine<kRadius + 1>(reference, window, samples);
  constexpr float kScale = 1.0f / (1 << (2 * kWeightBits));
  for (int r = 0; r < kSide; ++r) {
    const int32_t* s = samples + (r + 1) * kWide + 1;
    float* value = t->value + r * kRow;
    float* dx = t->dx + r * kRow;
    float* dy = t->dy + r * kRow;
    for (int c = 0; c < kSide; ++c) {
      value[c] = static_cast<float>(s[c]) * kScale;
      dx[c] = static_cast<float>(s[c + 1] - s[c - 1]) * (0.5f * kScale);
      dy[c] = static_cast<float>(s[c + kWide] - s[c - kWide]) * (0.5f * kScale);
    }
    for (int c = kSide; c < kRow; ++c) value[c] = dx[c] = dy[c] = 0;
  }
}

// False where the patch does not fix both coordinates.
HWY_INLINE bool make_template(const GrayView& reference, const AffineWindow& window, Template* t) {
  load_template(reference, window, t);
  for (float* layer : {t->value, t->dx, t->dy})
    subtract(layer, dot(layer, kInside.value) / kCount, kInside.value);
  t->norm2 = dot(t->value, t->value);
  if (!(t->norm2 > 0)) return false;
  for (float* layer : {t->dx, t->dy}) subtract(layer, dot(layer, t->value) / t->norm2, t->value);

  const float xx = dot(t->dx, t->dx), xy = dot(t->dx, t->dy), yy = dot(t->dy, t->dy);
  const float least = 0.5f * (xx + yy - std::sqrt((xx - yy) * (xx - yy) + 4 * xy * xy));
  if (!(least > kMinCurvature)) return false;
  const float det = xx * yy - xy * xy;
  t->hxx = yy / det;
  t->hxy = -xy / det;
  t->hyy = xx / det;
  return true;
}

// Sums over the patch of the target that begins at `block`, moved by (fx, fy) in [0, 1).
HWY_INLINE Sums correlate(const Template& t, const PixelBlock& block, float fx, float fy) {
  const hn::Rebind<uint8_t, decltype(kFloats)> bytes;
  const hn::Rebind<int32_t, decltype(kFloats)> ints;
  const auto wx = hn::Set(kFloats, fx), wy = hn::Set(kFloats, fy);
  const auto load = [&](const uint8_t* p)
                        HWY_ATTR { return hn::ConvertTo(kFloats, hn::PromoteTo(ints, hn::LoadU(bytes, p))); };
  const auto blend_row = [&](const uint8_t* p) HWY_ATTR {
    const auto left = load(p);
    return hn::Add(left, hn::Mul(wx, hn::Sub(load(p + 1), left)));
  };
  alignas(64) float columns[5][kRow] = {};
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
    hn::Store(dx, kFloats, columns[0] + c);
    hn::Store(dy, kFloats, columns[1] + c);
    hn::Store(value, kFloats, columns[2] + c);
    hn::Store(one, kFloats, columns[3] + c);
    hn::Store(square, kFloats, columns[4] + c);
  }
  return {sum_columns(columns[0]), sum_columns(columns[1]), sum_columns(columns[2]), sum_columns(columns[3]),
          sum_columns(columns[4])};
}

PatchAlignment align_patch(const GrayView& reference, const AffineWindow& window, const GrayView& target,
                           const Eigen::Vector2f& initial, const PatchAlignmentOptions& options) {
  PatchAlignment result{initial, 0, false};
  Template t;
  if (!make_template(reference, window, &t)) return result;
  BlockBuffer<kSide + 1> buffer;
  Eigen::Vector2f p = initial;
  for (int iteration = 0; iteration < options.max_iterations; ++iteration) {
    const float u = std::floor(p.x()), v = std::floor(p.y());
    const bool inside = u >= kRadius && v >= kRadius && u < static_cast<float>(target.width - kRadius - 1) &&
                        v < static_cast<float>(target.height - kRadius - 1);
    if (!inside) return result;
    const PixelBlock block = readable_block<kSide + 1>(target, static_cast<int>(u) - kRadius,
                                                       static_cast<int>(v) - kRadius, kSide + 1, &buffer);
    const Sums s = correlate(t, block, p.x() - u, p.y() - v);
    // The sample is gain * template + bias, moved; a dark copy (negative gain) is another patch.
    const float gain = s.value / t.norm2;
    const float variance = s.square - s.one * s.one / kCount;
    if (!(gain > 0 && variance > 0)) return result;
    result.zncc = std::min(1.0f, s.value / std::sqrt(t.norm2 * variance));
    const Eigen::Vector2f step(-(t.hxx * s.dx + t.hxy * s.dy) / gain, -(t.hxy * s.dx + t.hyy * s.dy) / gain);
    p += step;
    if (!((p - initial).squaredNorm() <= options.max_shift_px * options.max_shift_px)) return result;
    if (step.squaredNorm() > options.stop_px * options.stop_px) continue;
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
