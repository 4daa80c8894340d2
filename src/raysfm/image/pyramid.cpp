#include "raysfm/image/pyramid.h"

#include <algorithm>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "raysfm/image/pyramid.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace raysfm {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// One row of half_sample(): out[x] is the mean of columns 2 x and 2 x + 1 of both rows.
void half_sample_row(const uint8_t* top, const uint8_t* bottom, int out_width, uint8_t* out) {
#if HWY_TARGET != HWY_SCALAR
  const hn::ScalableTag<uint8_t> d8;
  const hn::RepartitionToWide<decltype(d8)> d16;
  const hn::RebindToSigned<decltype(d16)> di16;
  const hn::Rebind<uint8_t, decltype(d16)> d8_half;
  const int lanes = static_cast<int>(hn::Lanes(d16));
  const auto low_byte = hn::Set(d16, 0xff);
  const auto two = hn::Set(d16, 2);
  for (int step = 0; out_width >= lanes && step < out_width; step += lanes) {
    const int x = std::min(step, out_width - lanes);  // the last vector overlaps the one before
    const auto a = hn::BitCast(d16, hn::LoadU(d8, top + 2 * x));
    const auto b = hn::BitCast(d16, hn::LoadU(d8, bottom + 2 * x));
    const auto even = hn::Add(hn::And(a, low_byte), hn::And(b, low_byte));
    const auto odd = hn::Add(hn::ShiftRight<8>(a), hn::ShiftRight<8>(b));
    const auto mean = hn::ShiftRight<2>(hn::Add(hn::Add(even, odd), two));
    hn::StoreU(hn::DemoteTo(d8_half, hn::BitCast(di16, mean)), d8_half, out + x);
  }
  if (out_width >= lanes) return;
#endif
  for (int x = 0; x < out_width; ++x) {
    const int sum = top[2 * x] + top[2 * x + 1] + bottom[2 * x] + bottom[2 * x + 1];
    out[x] = static_cast<uint8_t>((sum + 2) >> 2);
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace raysfm
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace raysfm {

HWY_EXPORT(half_sample_row);

void half_sample(const GrayView& image, GrayImage* half) {
  half->resize(image.width / 2, image.height / 2);
  for (int y = 0; y < half->height(); ++y) {
    HWY_DYNAMIC_DISPATCH(half_sample_row)
    (image.row(2 * y), image.row(2 * y + 1), half->width(), half->row(y));
  }
}

void make_pyramid(const GrayView& image, int levels, std::vector<GrayImage>* pyramid) {
  constexpr int kMinSide = 16;
  int made = 0;
  GrayView above = image;
  while (made < levels && std::min(above.width, above.height) / 2 >= kMinSide) {
    if (made == static_cast<int>(pyramid->size())) pyramid->emplace_back();
    half_sample(above, &(*pyramid)[made]);
    above = (*pyramid)[made].view();
    ++made;
  }
  pyramid->resize(made);
}

int make_thumbnail(const GrayView& image, int max_width, GrayImage* thumbnail) {
  if (image.width <= max_width) {
    thumbnail->resize(image.width, image.height);
    for (int y = 0; y < image.height; ++y) {
      std::copy_n(image.row(y), image.width, thumbnail->row(y));
    }
    return 1;
  }
  int side = 2;
  half_sample(image, thumbnail);
  while (thumbnail->width() > max_width) {
    GrayImage half;
    half_sample(thumbnail->view(), &half);
    std::swap(*thumbnail, half);
    side *= 2;
  }
  return side;
}

}  // namespace raysfm
#endif  // HWY_ONCE
