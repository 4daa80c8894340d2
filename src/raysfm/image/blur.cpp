#include "raysfm/image/blur.h"

#include <algorithm>
#include <vector>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "raysfm/image/blur.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace raysfm {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// sums[x] = (side (above[x] + below[x]) + (256 - 2 side) row[x]) / 4: 64 for each grey level.
void sum_columns(const uint8_t* above, const uint8_t* row, const uint8_t* below, int width, int side,
                 uint16_t* sums) {
  const hn::ScalableTag<uint16_t> d16;
  const hn::Rebind<uint8_t, decltype(d16)> d8;
  const int lanes = static_cast<int>(hn::Lanes(d16)), middle = 256 - 2 * side;
  if (width < lanes) {
    for (int x = 0; x < width; ++x) {
      sums[x] = static_cast<uint16_t>((side * (above[x] + below[x]) + middle * row[x] + 2) >> 2);
    }
    return;
  }
  const auto of_side = hn::Set(d16, static_cast<uint16_t>(side));
  const auto of_middle = hn::Set(d16, static_cast<uint16_t>(middle));
  for (int step = 0; step < width; step += lanes) {
    const int x = std::min(step, width - lanes);
    const auto outer =
        hn::Add(hn::PromoteTo(d16, hn::LoadU(d8, above + x)), hn::PromoteTo(d16, hn::LoadU(d8, below + x)));
    const auto inner = hn::PromoteTo(d16, hn::LoadU(d8, row + x));
    const auto sum = hn::Add(hn::Mul(outer, of_side), hn::Mul(inner, of_middle));  // at most 255 * 256
    hn::StoreU(hn::ShiftRight<2>(hn::Add(sum, hn::Set(d16, 2))), d16, sums + x);
  }
}

// out[x] is the same of sums[x - 1], sums[x] and sums[x + 1], in grey levels; sums[-1] and sums[width] are
// readable.
void sum_rows(const uint16_t* sums, int width, int side, uint8_t* out) {
  const hn::ScalableTag<uint16_t> d16;
  const hn::Rebind<uint8_t, decltype(d16)> d8;
  const hn::Rebind<int16_t, decltype(d16)> signed16;
  const int lanes = static_cast<int>(hn::Lanes(d16));
  // The half of what is taken from the middle to the sides: 2^16 would not fit.
  const auto share = static_cast<uint16_t>(side << 9);
  if (width < lanes) {
    for (int x = 0; x < width; ++x) {
      const int outer = (sums[x - 1] + sums[x + 1]) * (side << 8) >> 16, taken = sums[x] * share >> 16;
      out[x] = static_cast<uint8_t>((outer + sums[x] - taken + 32) >> 6);
    }
    return;
  }
  for (int step = 0; step < width; step += lanes) {
    const int x = std::min(step, width - lanes);
    const auto middle = hn::LoadU(d16, sums + x);
    const auto outer = hn::Add(hn::LoadU(d16, sums + x - 1), hn::LoadU(d16, sums + x + 1));
    const auto from_sides = hn::MulHigh(outer, hn::Set(d16, static_cast<uint16_t>(side << 8)));
    const auto taken = hn::MulHigh(middle, hn::Set(d16, share));
    const auto mean =
        hn::ShiftRight<6>(hn::Add(hn::Add(from_sides, hn::Sub(middle, taken)), hn::Set(d16, 32)));
    hn::StoreU(hn::DemoteTo(d8, hn::BitCast(signed16, mean)), d8, out + x);
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace raysfm
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace raysfm {

HWY_EXPORT(sum_columns);
HWY_EXPORT(sum_rows);

void blur3(const GrayView& image, int side, GrayImage* out) {
  out->resize(image.width, image.height);
  if (image.empty()) return;
  std::vector<uint16_t> line(image.width + 2);
  uint16_t* sums = line.data() + 1;
  for (int y = 0; y < image.height; ++y) {
    const uint8_t* above = image.row(std::max(y - 1, 0));
    const uint8_t* below = image.row(std::min(y + 1, image.height - 1));
    HWY_DYNAMIC_DISPATCH(sum_columns)(above, image.row(y), below, image.width, side, sums);
    sums[-1] = sums[0];
    sums[image.width] = sums[image.width - 1];
    HWY_DYNAMIC_DISPATCH(sum_rows)(sums, image.width, side, out->row(y));
  }
}

}  // namespace raysfm
#endif  // HWY_ONCE
