#include "raysfm/image/pixels.h"

#include <algorithm>

namespace raysfm {
namespace {

int bytes_of(PixelFormat format) {
  if (format == PixelFormat::kGray) return 1;
  return format == PixelFormat::kRgb || format == PixelFormat::kBgr ? 3 : 4;
}

bool blue_first(PixelFormat format) {
  return format == PixelFormat::kBgr || format == PixelFormat::kBgra;
}

}  // namespace

void copy_pixels(const PixelView& pixels, GrayImage* gray, ColorPlanes* colors) {
  *colors = {};
  const auto row = [&](int y) { return pixels.data + y * pixels.stride; };
  if (pixels.format == PixelFormat::kGray) {
    *gray = GrayImage(pixels.width, pixels.height);
    for (int y = 0; y < pixels.height; ++y) std::copy_n(row(y), pixels.width, gray->row(y));
    return;
  }
  const int bytes = bytes_of(pixels.format);
  const int red = blue_first(pixels.format) ? 2 : 0;
  colors->rgb = Image<uint8_t>(3 * pixels.width, pixels.height);
  for (int y = 0; y < pixels.height; ++y) {
    const uint8_t* in = row(y);
    uint8_t* out = colors->rgb.row(y);
    for (int x = 0; x < pixels.width; ++x, in += bytes, out += 3) {
      out[0] = in[red];
      out[1] = in[1];
      out[2] = in[2 - red];
    }
  }
  *gray = gray_of(*colors);
}

}  // namespace raysfm
