#include "raysfm/io/decoded_image.h"

#include <fmt/format.h>

namespace raysfm {

Result<void> check_image_size(int64_t width, int64_t height) {
  if (width > 0 && height > 0 && width <= kMaxImageSide && height <= kMaxImageSide &&
      width * height <= kMaxImagePixels) {
    return {};
  }
  return bad_input(
      fmt::format("{} x {} pixels; allowed: sides from 1 to {}, 2^29 pixels", width, height, kMaxImageSide));
}

GrayImage gray_of(const ColorPlanes& colors) {
  constexpr int kShift = 15;
  constexpr int kRed = 9798, kGreen = 19235, kBlue = 3735;  // sum 2^15
  GrayImage gray(colors.rgb.width() / colors.values_per_pixel, colors.rgb.height());
  for (int y = 0; y < gray.height(); ++y) {
    const uint8_t* in = colors.rgb.row(y);
    uint8_t* out = gray.row(y);
    for (int x = 0; x < gray.width(); ++x, in += colors.values_per_pixel) {
      out[x] = static_cast<uint8_t>((kRed * in[0] + kGreen * in[1] + kBlue * in[2] + (1 << (kShift - 1))) >>
                                    kShift);
    }
  }
  return gray;
}

}  // namespace raysfm
