#include "raysfm/image/color_planes.h"

#include <algorithm>
#include <cmath>

namespace raysfm {

std::array<uint8_t, 3> ColorPlanes::at(int x, int y, uint8_t grey) const {
  if (!rgb.empty()) {
    const uint8_t* p = rgb.row(y) + ptrdiff_t{x} * values_per_pixel;
    return {p[0], p[1], p[2]};
  }
  if (cb.empty()) return {grey, grey, grey};
  const float b = static_cast<float>(cb.row(y / step_y)[x / step_x]) - 128;
  const float r = static_cast<float>(cr.row(y / step_y)[x / step_x]) - 128;
  const auto level = [grey](float change) {
    return static_cast<uint8_t>(std::clamp(std::lround(static_cast<float>(grey) + change), 0l, 255l));
  };
  return {level(mix.red_cr * r), level(mix.green_cb * b + mix.green_cr * r), level(mix.blue_cb * b)};
}

}  // namespace raysfm
