#include "raysfm/features/patches.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "raysfm/features/patch_window.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "raysfm/features/patches.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include "raysfm/features/patch_sampling-inl.h"

HWY_BEFORE_NAMESPACE();
namespace raysfm {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// Samples are grey levels times kLevels, which leaves room for their differences in 16 bits.
constexpr int kWeightSteps = 8;  // of bilinear weights: positions are rounded to an eighth of a pixel
constexpr int kLevels = kWeightSteps * kWeightSteps;
// Standard deviation, grey levels, below which a patch counts as having no texture: the noise of a camera.
constexpr int kMinDeviation = 2;

const hn::CappedTag<int16_t, 32> kShorts;

// Exact, so the order of the sum does not matter.
HWY_INLINE int32_t dot(const int16_t* HWY_RESTRICT a, const int16_t* HWY_RESTRICT b) {
#if HWY_TARGET == HWY_SCALAR
  int32_t sum = 0;
  for (int i = 0; i < kPatchStride; ++i) sum += a[i] * b[i];
  return sum;
#else
  const hn::RepartitionToWide<decltype(kShorts)> d32;
  auto even = hn::Zero(d32), odd = hn::Zero(d32);
  for (int i = 0; i < kPatchStride; i += static_cast<int>(hn::Lanes(kShorts))) {
    even = hn::ReorderWidenMulAccumulate(d32, hn::Load(kShorts, a + i), hn::Load(kShorts, b + i), even, odd);
  }
  return hn::GetLane(hn::SumOfLanes(d32, hn::Add(even, odd)));
#endif
}

// One inside the patch, zero in its padding.
struct InsidePatch {
  constexpr InsidePatch() {
    for (int i = 0; i < kPatchArea; ++i) value[i] = 1;
  }
  alignas(64) int16_t value[kPatchStride] = {};
};
static constexpr InsidePatch kInside;

// Takes the mean away, scales to bytes and returns the inverse norm of the bytes, zero without texture.
// `samples` is aligned to 64 bytes; what it holds behind the patch does not matter.
float normalise(int16_t* HWY_RESTRICT samples, int8_t* HWY_RESTRICT bytes) {
  const int lanes = static_cast<int>(hn::Lanes(kShorts));
  const int32_t sum = dot(samples, kInside.value);
  const auto mean = hn::Set(kShorts, static_cast<int16_t>((2 * sum + kPatchArea) / (2 * kPatchArea)));
  auto most = hn::Zero(kShorts);
  for (int i = 0; i < kPatchStride; i += lanes) {
    const auto less_mean =
        hn::Mul(hn::Sub(hn::Load(kShorts, samples + i), mean), hn::Load(kShorts, kInside.value + i));
    hn::Store(less_mean, kShorts, samples + i);
    most = hn::Max(most, hn::Abs(less_mean));
  }
  const int greatest = hn::GetLane(hn::MaxOfLanes(kShorts, most));
  // A patch with the least deviation has a sample that is at least as far from the mean, so the factor below
  // fits 16 bits.
  if (greatest < kMinDeviation * kLevels) return 0;
  const auto factor = hn::Set(kShorts, static_cast<int16_t>((127 * 32768 + greatest / 2) / greatest));
  const hn::Rebind<int8_t, decltype(kShorts)> d8;
  for (int i = 0; i < kPatchStride; i += lanes) {
    const auto scaled = hn::MulFixedPoint15(hn::Load(kShorts, samples + i), factor);
    hn::Store(scaled, kShorts, samples + i);
    hn::Store(hn::DemoteTo(d8, scaled), d8, bytes + i);
  }
  const int32_t norm2 = dot(samples, samples);
  const float scale = 127.0f / static_cast<float>(greatest);
  const float least = static_cast<float>(kMinDeviation * kLevels) * scale;
  if (static_cast<float>(norm2) < kPatchArea * least * least) return 0;
  return 1.0f / std::sqrt(static_cast<float>(norm2));
}

// The block begins kPatchRadius to the upper left of the pixel; (wx, wy) is the rest, in eighths.
void sample_shifted(const PixelBlock& block, int wx, int wy, int16_t* HWY_RESTRICT samples) {
  const hn::CappedTag<int16_t, 16> d;
  const hn::Rebind<uint8_t, decltype(d)> d8;
  const int lanes = static_cast<int>(hn::Lanes(d));
  const auto left = hn::Set(d, static_cast<int16_t>(kWeightSteps - wx));
  const auto right = hn::Set(d, static_cast<int16_t>(wx));
  const auto upper = hn::Set(d, static_cast<int16_t>(kWeightSteps - wy));
  const auto lower = hn::Set(d, static_cast<int16_t>(wy));
  const auto blend_row = [&](int r, int c) HWY_ATTR {
    const uint8_t* p = block.data + r * block.stride + c;
    return hn::Add(hn::Mul(left, hn::PromoteTo(d, hn::LoadU(d8, p))),
                   hn::Mul(right, hn::PromoteTo(d, hn::LoadU(d8, p + 1))));
  };
  // Vectors reach past the end of a row; what they write there is overwritten by the next row, or later by
  // the columns to the left.
  for (int c = (kPatchSide - 1) / lanes * lanes; c >= 0; c -= lanes) {
    auto above = blend_row(0, c);
    for (int r = 0; r < kPatchSide; ++r) {
      const auto below = blend_row(r + 1, c);
      const auto value = hn::Add(hn::Mul(upper, above), hn::Mul(lower, below));
      hn::StoreU(value, d, samples + r * kPatchSide + c);
      above = below;
    }
  }
}

void extract_shifted(const GrayView& image, const Eigen::Vector2f* pixels, int count, PatchSet* patches) {
  // A patch is normalised after the next one was sampled: vectors that are read right after parts of them
  // were written wait for these.
  alignas(64) std::array<std::array<int16_t, kPatchStride + 64>, 2> samples;
  BlockBuffer<kPatchSide + 1> buffer;
  int waiting = -1;  // sampled, not normalised; its samples are those of its number's parity
  const auto normalise_waiting = [&] {
    if (waiting < 0) return;
    patches->set_inverse_norm(waiting,
                              normalise(samples[waiting % 2].data(), patches->mutable_patch(waiting)));
    waiting = -1;
  };
  for (int i = 0; i < count; ++i) {
    const float x = pixels[i].x() * kWeightSteps, y = pixels[i].y() * kWeightSteps;
    const bool inside = x >= kPatchRadius * kWeightSteps && y >= kPatchRadius * kWeightSteps &&
                        x < static_cast<float>((image.width - kPatchRadius - 2) * kWeightSteps) &&
                        y < static_cast<float>((image.height - kPatchRadius - 2) * kWeightSteps);
    patches->set_inverse_norm(i, 0);
    if (!inside) continue;
    const int xi = static_cast<int>(x + 0.5f), yi = static_cast<int>(y + 0.5f);
    const PixelBlock block = readable_block<kPatchSide + 1>(
        image, xi / kWeightSteps - kPatchRadius, yi / kWeightSteps - kPatchRadius, kPatchSide + 1, &buffer);
    if (waiting >= 0 && (i - waiting) % 2 == 0) normalise_waiting();  // it is where this one goes
    sample_shifted(block, xi % kWeightSteps, yi % kWeightSteps, samples[i % 2].data());
    normalise_waiting();
    waiting = i;
  }
  normalise_waiting();
}

void extract_warped(const GrayView& image, const Eigen::Vector2f& pixel, const Eigen::Matrix2f& m, int i,
                    PatchSet* patches) {
  patches->set_inverse_norm(i, 0);
  const auto window = affine_window(image, pixel, m, kPatchRadius);
  if (!window) return;
  alignas(64) int16_t samples[kPatchStride];
  static_assert((1 << kLevelBits) == kLevels);
  sample_affine<kPatchRadius>(image, *window, samples);
  patches->set_inverse_norm(i, normalise(samples, patches->mutable_patch(i)));
}

}  // namespace HWY_NAMESPACE
}  // namespace raysfm
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace raysfm {

HWY_EXPORT(extract_shifted);
HWY_EXPORT(extract_warped);

void PatchSet::resize(int size) {
  const auto needed = static_cast<size_t>(size);
  if (needed > capacity_) {
    capacity_ = std::max(needed, 2 * capacity_);
    data_.reset(static_cast<int8_t*>(::operator new (capacity_* kPatchStride, std::align_val_t{64})));
  }
  inverse_norms_.assign(needed, 0.0f);
}

void extract_patches(const GrayView& image, std::span<const Eigen::Vector2f> pixels, PatchSet* patches) {
  patches->resize(static_cast<int>(pixels.size()));
  HWY_DYNAMIC_DISPATCH(extract_shifted)(image, pixels.data(), patches->size(), patches);
}

void extract_warped_patches(std::span<const GrayView> levels, std::span<const Eigen::Vector2f> pixels,
                            std::span<const Eigen::Matrix2f> image_from_target, PatchSet* patches) {
  patches->resize(static_cast<int>(pixels.size()));
  for (int i = 0; i < patches->size(); ++i) {
    // The area of the image that one pixel of the patch covers quarters with every level.
    const Eigen::Matrix2f& m = image_from_target[i];
    float area = std::abs(m(0, 0) * m(1, 1) - m(0, 1) * m(1, 0));
    size_t level = 0;
    float scale = 1;
    while (level + 1 < levels.size() && area > 1.5f * 1.5f) {
      ++level;
      area /= 4;
      scale /= 2;
    }
    const Eigen::Vector2f half = Eigen::Vector2f::Constant(0.5f);
    const Eigen::Vector2f pixel = (pixels[i] + half) * scale - half;
    HWY_DYNAMIC_DISPATCH(extract_warped)
    (levels[level], pixel, scale * m, i, patches);
  }
}

void extract_warped_patches(const GrayView& image, std::span<const Eigen::Vector2f> pixels,
                            std::span<const Eigen::Matrix2f> image_from_target, PatchSet* patches) {
  extract_warped_patches(std::span(&image, 1), pixels, image_from_target, patches);
}

float zncc(const PatchSet& a, int i, const PatchSet& b, int j) {
  if (!a.valid(i) || !b.valid(j)) return 0;
  int dot = 0;
  for (int k = 0; k < kPatchStride; ++k) dot += a.patch(i)[k] * b.patch(j)[k];
  return static_cast<float>(dot) * a.inverse_norm(i) * b.inverse_norm(j);
}

}  // namespace raysfm
#endif  // HWY_ONCE
