#include "raysfm/image/luma.h"

#include <algorithm>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "raysfm/image/luma.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace raysfm {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

void stretch_luma_row(const uint8_t* in, int count, uint8_t* out) {
#if HWY_TARGET != HWY_SCALAR
  const hn::ScalableTag<uint16_t> d16;
  const hn::RebindToSigned<decltype(d16)> di16;
  const hn::Rebind<uint8_t, decltype(d16)> d8;
  const int lanes = static_cast<int>(hn::Lanes(d16));
  const auto black = hn::Set(d16, 16), white = hn::Set(d16, 235);
  // (255 (v - 16) + 109) / 219, as a product of 16 bits: exact for every v.
  const auto most = hn::Set(d16, 255), half = hn::Set(d16, 109), inverse = hn::Set(d16, 19153);
  for (int step = 0; count >= lanes && step < count; step += lanes) {
    const int x = std::min(step, count - lanes);  // the last vector overlaps the one before
    const auto v = hn::PromoteTo(d16, hn::LoadU(d8, in + x));
    const auto above = hn::Sub(hn::Min(hn::Max(v, black), white), black);
    const auto level = hn::ShiftRight<6>(hn::MulHigh(hn::Add(hn::Mul(above, most), half), inverse));
    hn::StoreU(hn::DemoteTo(d8, hn::BitCast(di16, level)), d8, out + x);
  }
  if (count >= lanes) return;
#endif
  for (int x = 0; x < count; ++x) out[x] = stretched_level(in[x], 16, 235);
}

}  // namespace HWY_NAMESPACE
}  // namespace raysfm
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace raysfm {

HWY_EXPORT(stretch_luma_row);

void stretch_luma(const uint8_t* in, int count, uint8_t* out) {
  HWY_DYNAMIC_DISPATCH(stretch_luma_row)(in, count, out);
}

uint8_t stretched_level(int64_t value, int64_t low, int64_t high) {
  const int64_t level = ((value - low) * 255 * 2 + (high - low)) / (2 * (high - low));
  return static_cast<uint8_t>(std::clamp<int64_t>(level, 0, 255));
}

}  // namespace raysfm
#endif
