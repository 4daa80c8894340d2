#include "raysfm/image/color_planes.h"

namespace raysfm {

std::array<uint8_t, 3> ColorPlanes::at(int x, int y, uint8_t grey) const {
  if (!rgb.empty()) {
    const uint8_t* p = rgb.row(y) + ptrdiff_t{x} * values_per_pixel;
    return {p[0], p[1], p[2]};
  }
  if (cb.empty()) return {grey, grey, grey};
  const float b = static_cast<float>(cb.row(y / step_y)[x / step_x]) - 128;
  const float r = static_cast<float>(cr.row(y / step_y)[x / step_x]) - 128;
  const auto level = [grey](float change) { return rounded_level(static_cast<float>(grey) + change); };
  return {level(mix.red_cr * r), level(mix.green_cb * b + mix.green_cr * r), level(mix.blue_cb * b)};
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
