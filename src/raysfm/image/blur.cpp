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

// sums[x] = above[x] + 2 row[x] + below[x].
void sum_columns(const uint8_t* above, const uint8_t* row, const uint8_t* below, int width, uint16_t* sums) {
  const hn::ScalableTag<uint16_t> d16;
  const hn::Rebind<uint8_t, decltype(d16)> d8;
  const int lanes = static_cast<int>(hn::Lanes(d16));
  if (width < lanes) {
    for (int x = 0; x < width; ++x) sums[x] = static_cast<uint16_t>(above[x] + 2 * row[x] + below[x]);
    return;
  }
  for (int step = 0; step < width; step += lanes) {
    const int x = std::min(step, width - lanes);
    const auto outer =
        hn::Add(hn::PromoteTo(d16, hn::LoadU(d8, above + x)), hn::PromoteTo(d16, hn::LoadU(d8, below + x)));
    const auto twice = hn::ShiftLeft<1>(hn::PromoteTo(d16, hn::LoadU(d8, row + x)));
    hn::StoreU(hn::Add(outer, twice), d16, sums + x);
  }
}

// out[x] = (sums[x - 1] + 2 sums[x] + sums[x + 1] + 8) / 16; sums[-1] and sums[width] are readable.
void sum_rows(const uint16_t* sums, int width, uint8_t* out) {
  const hn::ScalableTag<int16_t> d16;
  const hn::Rebind<uint8_t, decltype(d16)> d8;
  const int lanes = static_cast<int>(hn::Lanes(d16));
  if (width < lanes) {
    for (int x = 0; x < width; ++x) {
      out[x] = static_cast<uint8_t>((sums[x - 1] + 2 * sums[x] + sums[x + 1] + 8) >> 4);
    }
    return;
  }
  const auto* signed_sums = reinterpret_cast<const int16_t*>(sums);  // at most 4 * 255
  for (int step = 0; step < width; step += lanes) {
    const int x = std::min(step, width - lanes);
    const auto outer = hn::Add(hn::LoadU(d16, signed_sums + x - 1), hn::LoadU(d16, signed_sums + x + 1));
    const auto twice = hn::ShiftLeft<1>(hn::LoadU(d16, signed_sums + x));
    const auto mean = hn::ShiftRight<4>(hn::Add(hn::Add(outer, twice), hn::Set(d16, 8)));
    hn::StoreU(hn::DemoteTo(d8, mean), d8, out + x);
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace raysfm
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace raysfm {

HWY_EXPORT(sum_columns);
HWY_EXPORT(sum_rows);

void blur3(const GrayView& image, GrayImage* out) {
  out->resize(image.width, image.height);
  if (image.empty()) return;
  std::vector<uint16_t> line(image.width + 2);
  uint16_t* sums = line.data() + 1;
  for (int y = 0; y < image.height; ++y) {
    const uint8_t* above = image.row(std::max(y - 1, 0));
    const uint8_t* below = image.row(std::min(y + 1, image.height - 1));
    HWY_DYNAMIC_DISPATCH(sum_columns)(above, image.row(y), below, image.width, sums);
    sums[-1] = sums[0];
    sums[image.width] = sums[image.width - 1];
    HWY_DYNAMIC_DISPATCH(sum_rows)(sums, image.width, out->row(y));
  }
}

}  // namespace raysfm
#endif  // HWY_ONCE
