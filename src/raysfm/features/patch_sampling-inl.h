// Bilinear sampling of patches, compiled once for each instruction set; see highway's foreach_target.h.
#if defined(RAYSFM_FEATURES_PATCH_SAMPLING_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef RAYSFM_FEATURES_PATCH_SAMPLING_INL_H_
#undef RAYSFM_FEATURES_PATCH_SAMPLING_INL_H_
#else
#define RAYSFM_FEATURES_PATCH_SAMPLING_INL_H_
#endif

#include <hwy/highway.h>

#include "raysfm/features/patch_window.h"

HWY_BEFORE_NAMESPACE();
namespace raysfm {
namespace HWY_NAMESPACE {

// Offsets of the pixels of a square patch from its centre, row by row, padded with zeros to whole vectors of
// up to 16 lanes.
template <int kRadius>
struct PatchOffsets {
  static constexpr int kSide = 2 * kRadius + 1;
  static constexpr int kPadded = (kSide * kSide + 15) / 16 * 16;
  constexpr PatchOffsets() {
    for (int i = 0; i < kSide * kSide; ++i) {
      x[i] = i % kSide - kRadius;
      y[i] = i / kSide - kRadius;
    }
  }
  alignas(64) int32_t x[kPadded] = {};
  alignas(64) int32_t y[kPadded] = {};
};

constexpr int kWeightBits = 10;
// A sample is a grey level times 2^kLevelBits.
constexpr int kLevelBits = 6;

// Writes kPadded samples. The window lies inside the image (affine_window()). Integers only: the same on
// every instruction set.
template <int kRadius>
HWY_INLINE void sample_affine(const GrayView& image, const AffineWindow& w, int16_t* HWY_RESTRICT samples) {
  namespace hn = hwy::HWY_NAMESPACE;
  static constexpr PatchOffsets<kRadius> kOffsets;
  const hn::CappedTag<int32_t, 16> d;
  const hn::Rebind<int16_t, decltype(d)> shorts;
  const auto* base = reinterpret_cast<const int32_t*>(image.data);
  const auto stride = hn::Set(d, static_cast<int32_t>(image.stride));
  const auto byte = hn::Set(d, 0xff), weight_mask = hn::Set(d, (1 << kWeightBits) - 1);
  const auto m00 = hn::Set(d, w.m00), m01 = hn::Set(d, w.m01);
  const auto m10 = hn::Set(d, w.m10), m11 = hn::Set(d, w.m11);
  // Half a step of the weights, so that cutting the lower bits rounds.
  constexpr int kDropped = kFixedBits - kWeightBits;
  constexpr int kShift = 2 * kWeightBits - kLevelBits;
  const auto half_level = hn::Set(d, 1 << (kShift - 1));
  const auto x0 = hn::Set(d, w.x + (1 << (kDropped - 1))), y0 = hn::Set(d, w.y + (1 << (kDropped - 1)));
  for (int i = 0; i < PatchOffsets<kRadius>::kPadded; i += static_cast<int>(hn::Lanes(d))) {
    const auto ox = hn::Load(d, kOffsets.x + i), oy = hn::Load(d, kOffsets.y + i);
    const auto x = hn::Add(x0, hn::Add(hn::Mul(m00, ox), hn::Mul(m01, oy)));
    const auto y = hn::Add(y0, hn::Add(hn::Mul(m10, ox), hn::Mul(m11, oy)));
    const auto wx = hn::And(hn::ShiftRight<kDropped>(x), weight_mask);
    const auto wy = hn::And(hn::ShiftRight<kDropped>(y), weight_mask);
    const auto at = hn::Add(hn::Mul(hn::ShiftRight<kFixedBits>(y), stride), hn::ShiftRight<kFixedBits>(x));
    const auto top = hn::GatherOffset(d, base, at);
    const auto bottom = hn::GatherOffset(d, base, hn::Add(at, stride));
    const auto blend_row = [&](auto four) HWY_ATTR {
      const auto left = hn::And(four, byte), right = hn::And(hn::ShiftRight<8>(four), byte);
      return hn::Add(hn::ShiftLeft<kWeightBits>(left), hn::Mul(wx, hn::Sub(right, left)));
    };
    const auto a = blend_row(top), b = blend_row(bottom);
    const auto sample = hn::Add(hn::ShiftLeft<kWeightBits>(a), hn::Mul(wy, hn::Sub(b, a)));
    hn::Store(hn::DemoteTo(shorts, hn::ShiftRight<kShift>(hn::Add(sample, half_level))), shorts, samples + i);
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace raysfm
HWY_AFTER_NAMESPACE();

#endif
