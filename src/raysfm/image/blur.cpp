#include "raysfm/image/blur.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#ifndef RAYSFM_IMAGE_BLUR_FILTER5
#define RAYSFM_IMAGE_BLUR_FILTER5
namespace raysfm {
namespace {

// blur3() twice at once, and what it makes of levels. Sums of rows are 128 for each grey level, so that two
// of them fit 16 bits.
struct Filter5 {
  std::array<uint16_t, 3> of_rows;     // middle, near, far; of 256
  std::array<uint16_t, 3> of_columns;  // what the middle gives away, near, far; of 2^16
  int16_t from = 0;                    // a sum, which becomes
  int16_t to = 0;                      // this level; with the half that rounds it; in eighths
  int16_t gain = 0;                    // of 2^12
};

}  // namespace
}  // namespace raysfm
#endif

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

// sums[x] is the column of five under filter.of_rows, 128 for each grey level.
void sum_five_rows(const uint8_t* const* rows, int width, const Filter5& filter, uint16_t* sums) {
  const hn::ScalableTag<uint16_t> d16;
  const hn::Rebind<uint8_t, decltype(d16)> d8;
  const int lanes = static_cast<int>(hn::Lanes(d16));
  const auto [middle, near, far] = filter.of_rows;
  if (width < lanes) {
    for (int x = 0; x < width; ++x) {
      sums[x] = static_cast<uint16_t>(
          (middle * rows[2][x] + near * (rows[1][x] + rows[3][x]) + far * (rows[0][x] + rows[4][x]) + 1) >>
          1);
    }
    return;
  }
  for (int step = 0; step < width; step += lanes) {
    const int x = std::min(step, width - lanes);
    const auto level = [&](int row) { return hn::PromoteTo(d16, hn::LoadU(d8, rows[row] + x)); };
    const auto part = [&](auto levels, uint16_t weight) { return hn::Mul(levels, hn::Set(d16, weight)); };
    const auto sum = hn::Add(hn::Add(part(level(2), middle), part(hn::Add(level(1), level(3)), near)),
                             part(hn::Add(level(0), level(4)), far));  // at most 255 * 256
    hn::StoreU(hn::ShiftRight<1>(hn::Add(sum, hn::Set(d16, 1))), d16, sums + x);
  }
}

// out[x] is the same of sums[x - 2] to sums[x + 2], which are readable, and stretched.
void stretch_five(const uint16_t* sums, int width, const Filter5& filter, uint8_t* out) {
  const hn::ScalableTag<uint16_t> d16;
  const hn::RebindToSigned<decltype(d16)> signed16;
  const hn::Rebind<uint8_t, decltype(d16)> d8;
  const int lanes = static_cast<int>(hn::Lanes(d16));
  const auto [given, near, far] = filter.of_columns;
  if (width < lanes) {
    for (int x = 0; x < width; ++x) {
      const int mean = sums[x] - (sums[x] * given >> 16) + ((sums[x - 1] + sums[x + 1]) * near >> 16) +
                       ((sums[x - 2] + sums[x + 2]) * far >> 16);
      const int level = ((mean - filter.from) * filter.gain >> 16) + filter.to;
      out[x] = static_cast<uint8_t>(std::clamp(level >> 3, 0, 255));
    }
    return;
  }
  for (int step = 0; step < width; step += lanes) {
    const int x = std::min(step, width - lanes);
    const auto sum = [&](int aside) { return hn::LoadU(d16, sums + x + aside); };
    const auto part = [&](auto of, uint16_t weight) { return hn::MulHigh(of, hn::Set(d16, weight)); };
    const auto mean =
        hn::Add(hn::Sub(sum(0), part(sum(0), given)),
                hn::Add(part(hn::Add(sum(-1), sum(1)), near), part(hn::Add(sum(-2), sum(2)), far)));
    const auto aside = hn::Sub(hn::BitCast(signed16, mean), hn::Set(signed16, filter.from));
    const auto level =
        hn::Add(hn::MulHigh(aside, hn::Set(signed16, filter.gain)), hn::Set(signed16, filter.to));
    hn::StoreU(hn::DemoteTo(d8, hn::ShiftRight<3>(level)), d8, out + x);
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace raysfm
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace raysfm {

HWY_EXPORT(sum_columns);
HWY_EXPORT(sum_rows);
HWY_EXPORT(sum_five_rows);
HWY_EXPORT(stretch_five);

namespace {

Filter5 filter_of(int side, const Levels& levels) {
  const double s = side / 256.0, far = s * s, near = 2 * s * (1 - 2 * s);
  const auto of = [](double share, double whole) {
    return static_cast<uint16_t>(std::lround(share * whole));
  };
  Filter5 filter;
  const uint16_t near_rows = of(near, 256), far_rows = of(far, 256);
  filter.of_rows = {static_cast<uint16_t>(256 - 2 * (near_rows + far_rows)), near_rows, far_rows};
  const uint16_t near_columns = of(near, 1 << 16), far_columns = of(far, 1 << 16);
  filter.of_columns = {static_cast<uint16_t>(2 * (near_columns + far_columns)), near_columns, far_columns};
  filter.from = static_cast<int16_t>(std::lround(128 * levels.from));
  filter.to = static_cast<int16_t>(std::lround(8 * levels.to) + 4);
  filter.gain = static_cast<int16_t>(std::lround(4096 * levels.gain));
  return filter;
}

}  // namespace

void blur_and_stretch(const GrayView& image, int side, const Levels& levels, GrayImage* out) {
  out->resize(image.width, image.height);
  if (image.empty()) return;
  const Filter5 filter = filter_of(side, levels);
  std::vector<uint16_t> line(image.width + 4);
  uint16_t* sums = line.data() + 2;
  for (int y = 0; y < image.height; ++y) {
    std::array<const uint8_t*, 5> rows;
    for (int k = 0; k < 5; ++k) rows[k] = image.row(std::clamp(y + k - 2, 0, image.height - 1));
    HWY_DYNAMIC_DISPATCH(sum_five_rows)(rows.data(), image.width, filter, sums);
    sums[-2] = sums[-1] = sums[0];
    sums[image.width] = sums[image.width + 1] = sums[image.width - 1];
    HWY_DYNAMIC_DISPATCH(stretch_five)(sums, image.width, filter, out->row(y));
  }
}

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
