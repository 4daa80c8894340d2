#pragma once

#include <algorithm>
#include <array>
#include <cstdint>

#include "raysfm/image/image.h"

namespace raysfm {

// The colours of a grey image, kept as its file or video has them and worked out only for pixels that are
// asked for. Either red, green, blue side by side, or chroma, or nothing where the input is grey.
struct ColorPlanes {
  Image<uint8_t> rgb;  // width values_per_pixel * that of the image; values after the third do not count
  int values_per_pixel = 3;

  Image<uint8_t> cb, cr;       // about 128
  int step_x = 1, step_y = 1;  // pixels of the image per value of chroma
  // Shares of cb in green and blue and of cr in red and green; those of JPEG, full range.
  struct Mix {
    float red_cr = 1.402f, green_cb = -0.344136f, green_cr = -0.714136f, blue_cb = 1.772f;
  } mix;

  bool empty() const { return rgb.empty() && cb.empty(); }
  // Red, green, blue of the pixel (x, y) inside the image; `grey` is its level there.
  std::array<uint8_t, 3> at(int x, int y, uint8_t grey) const;
};

// The nearest of 0 to 255.
inline uint8_t rounded_level(float level) {
  return static_cast<uint8_t>(std::clamp(level, 0.f, 255.f) + 0.5f);
}

// 0.299 R + 0.587 G + 0.114 B of `colors.rgb`, which is not empty, rounded.
GrayImage gray_of(const ColorPlanes& colors);

}  // namespace raysfm
