// Bilinear sampling of patches, compiled once for each instruction set; see highway's foreach_target.h.
#if defined(RAYSFM_FEATURES_PATCH_SAMPLING_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef RAYSFM_FEATURES_PATCH_SAMPLING_INL_H_
#undef RAYSFM_FEATURES_PATCH_SAMPLING_INL_H_
#else
#define RAYSFM_FEATURES_PATCH_SAMPLING_INL_H_
#endif

#include <hwy/highway.h>

#include <algorithm>
#include <cstdlib>

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

// Any window: each sample gathers its four pixels.
template <int kRadius>
HWY_INLINE void gather_affine(const GrayView& image, const AffineWindow& w, int16_t* HWY_RESTRICT samples) {
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

// For each column c from `begin` on of a row of pixels: that of the offset in a column. The row is read in
// two blocks of 16 bytes, from its first and from its second on, which is that of columns 8 to 15.
struct RowPixels {
  const uint8_t* first;
  const uint8_t* second;

  template <class D, class V>
  HWY_INLINE V take(D d, int c, V offset) const {
    namespace hn = hwy::HWY_NAMESPACE;
    const uint8_t* own = c < 8 ? first : second;
#if HWY_TARGET == HWY_SCALAR
    return hn::Set(d, own[hn::GetLane(offset)]);
#else
    const hn::Repartition<uint8_t, D> bytes;
    const auto index = hn::Or(offset, hn::Set(d, static_cast<int16_t>(-32768)));  // no upper byte
    return hn::BitCast(d, hn::TableLookupBytesOr0(load(bytes, own), hn::BitCast(bytes, index)));
#endif
  }

#if HWY_TARGET != HWY_SCALAR
 private:
  template <class D>
  HWY_INLINE hwy::HWY_NAMESPACE::Vec<D> load(D d, const uint8_t* own) const {
    namespace hn = hwy::HWY_NAMESPACE;
    if constexpr (hn::MaxLanes(D()) > 16) {
      const hn::Half<D> half;
      return hn::Combine(d, hn::LoadU(half, second), hn::LoadU(half, first));
    } else {
      return hn::LoadU(d, own);
    }
  }
#endif
};

// A window that is turned and stretched little, as most are, in two passes without a gather, which is slow or
// made slow on most processors: along the rows of the image, at the columns of the patch, and then along
// those. Numbers are columns c and rows r of the patch, and rows y of the image.
template <int kRadius>
class RowSampler {
  using Shorts = hwy::HWY_NAMESPACE::CappedTag<int16_t, 16>;
  static constexpr int kSide = 2 * kRadius + 1, kRow = 16, kMaxRows = 32, kBlock = 8;
  static_assert(kSide <= kRow && kSide * (kSide - 1) + kRow <= PatchOffsets<kRadius>::kPadded);
  static constexpr int kOne = 1 << kFixedBits, kXBits = 11, kYBits = 12;

 public:
  // False where the window is too unlike the pixels.
  HWY_INLINE bool plan(const GrayView& image, const AffineWindow& w) {
    if (w.m11 < kOne / 2 || w.m11 > kOne * 9 / 5) return false;
    const int64_t shear = int64_t{w.m01} * kOne / w.m11;
    const int64_t step = w.m00 - (shear * w.m10 >> kFixedBits);
    rise_ = std::abs(w.m10) * kRadius;
    if (std::abs(shear) > kOne / 2 || step < kOne / 2 || step > kOne * 9 / 5 || rise_ >= kOne) return false;
    shear_ = static_cast<int>(shear), step_ = static_cast<int>(step);
    top_ = w.y - w.m11 * kRadius - rise_;
    first_row_ = top_ >> kFixedBits;
    rows_ = ((w.y + w.m11 * kRadius + rise_) >> kFixedBits) + 2 - first_row_;
    const int64_t down = int64_t{first_row_} * kOne - w.y;
    left_ = w.x - step_ * kRadius + static_cast<int>(shear * down >> kFixedBits);
    const int right = std::max(left_, left_ + shear_ * rows_) + step_ * kBlock;
    return first_row_ >= 0 && first_row_ + rows_ <= image.height && rows_ <= kMaxRows &&
           std::min(left_, left_ + shear_ * rows_) >= 0 && (right >> kFixedBits) + kRow <= image.width;
  }

  HWY_INLINE void sample(const GrayView& image, const AffineWindow& w, int16_t* HWY_RESTRICT samples) {
    along_rows(image);
    along_columns(w, samples);
  }

 private:
  HWY_INLINE void along_rows(const GrayView& image) {
    namespace hn = hwy::HWY_NAMESPACE;
    const Shorts d;
    // Columns from the block's first byte on, beside what the row adds.
    alignas(64) int16_t column[kRow];
    const int second = step_ * kBlock >> kFixedBits;
    for (int c = 0; c < kRow; ++c) {
      const int block = c < kBlock ? 0 : second << kFixedBits;
      column[c] = static_cast<int16_t>((step_ * c - block) >> (kFixedBits - kXBits));
    }
    const auto fraction = hn::Set(d, (1 << kXBits) - 1), one = hn::Set(d, 1);
    int x = left_;
    for (int y = 0; y < rows_; ++y, x += shear_) {
      const uint8_t* begin = image.row(first_row_ + y) + (x >> kFixedBits);
      const RowPixels pixels{begin, begin + second};
      const auto part = hn::Set(d, static_cast<int16_t>((x & (kOne - 1)) >> (kFixedBits - kXBits)));
      for (int c = 0; c < kSide; c += static_cast<int>(hn::Lanes(d))) {
        const auto at = hn::Add(part, hn::Load(d, column + c));
        const auto column_there = hn::ShiftRight<kXBits>(at);
        const auto left = hn::ShiftLeft<kLevelBits>(pixels.take(d, c, column_there));
        const auto right = hn::ShiftLeft<kLevelBits>(pixels.take(d, c, hn::Add(column_there, one)));
        const auto weight = hn::ShiftLeft<15 - kXBits>(hn::And(at, fraction));
        hn::Store(hn::Add(left, hn::MulFixedPoint15(hn::Sub(right, left), weight)), d,
                  rows_of_ + y * kRow + c);
      }
    }
  }

  HWY_INLINE void along_columns(const AffineWindow& w, int16_t* HWY_RESTRICT samples) {
    namespace hn = hwy::HWY_NAMESPACE;
    const Shorts d;
    alignas(64) int16_t height[kRow];  // of the columns, from the highest on
    for (int c = 0; c < kRow; ++c) {
      height[c] =
          static_cast<int16_t>((w.m10 * (std::min(c, kSide - 1) - kRadius) + rise_) >> (kFixedBits - kYBits));
    }
    const auto one = hn::Set(d, 1 << kYBits), zero = hn::Zero(d);
    int y = top_ - first_row_ * kOne;
    for (int r = 0; r < kSide; ++r, y += w.m11) {
      const int first = y >> kFixedBits, last = (y + 2 * rise_) >> kFixedBits;
      const auto part = hn::Set(d, static_cast<int16_t>((y & (kOne - 1)) >> (kFixedBits - kYBits)));
      for (int c = 0; c < kSide; c += static_cast<int>(hn::Lanes(d))) {
        auto below = hn::Add(part, hn::Load(d, height + c));  // the row
        auto sum = zero;
        for (int k = first; k <= last + 1; ++k) {
          const auto weight = hn::ShiftLeft<14 - kYBits>(hn::Max(zero, hn::Sub(one, hn::Abs(below))));
          const auto level = hn::Load(d, rows_of_ + k * kRow + c);
          sum = hn::Add(sum, hn::MulFixedPoint15(level, hn::SaturatedAdd(weight, weight)));
          below = hn::Sub(below, one);
        }
        hn::StoreU(sum, d, samples + r * kSide + c);
      }
    }
  }

  int shear_, step_;      // columns by row of the image, and by column of the patch
  int rise_;              // by which the middle of the patch is below its highest end
  int top_, left_;        // of the highest sample; column of the first, at the first row
  int first_row_, rows_;  // of the image
  alignas(64) int16_t rows_of_[kMaxRows * kRow];
};

template <int kRadius>
HWY_INLINE bool sample_by_rows(const GrayView& image, const AffineWindow& w, int16_t* HWY_RESTRICT samples) {
  RowSampler<kRadius> sampler;
  if (!sampler.plan(image, w)) return false;
  sampler.sample(image, w, samples);
  return true;
}

// Writes kPadded samples, of which those behind the patch do not matter. The window lies inside the image
// (affine_window()). Integers only: the same on every instruction set.
template <int kRadius>
HWY_INLINE void sample_affine(const GrayView& image, const AffineWindow& w, int16_t* HWY_RESTRICT samples) {
  if (!sample_by_rows<kRadius>(image, w, samples)) gather_affine<kRadius>(image, w, samples);
}

}  // namespace HWY_NAMESPACE
}  // namespace raysfm
HWY_AFTER_NAMESPACE();

#endif
