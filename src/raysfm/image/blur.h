#pragma once

#include "raysfm/image/image.h"

namespace raysfm {

constexpr int kBinomial = 64;  // side of blur3()

// Filter [s, 256 - 2 s, s] / 256 in both directions, s = `side` in 0 to 64, rounded to nearest; its variance
// is s / 128 square pixels. kBinomial is [1 2 1] / 4 (sigma 0.71 pixels). Pixels outside repeat the border.
// `out` takes the size of `image`; it must not share its memory.
void blur3(const GrayView& image, int side, GrayImage* out);

// What becomes of a grey level v: to + gain (v - from), cut off at 0 and 255. `from` and `to` in grey levels,
// 0 <= `gain` < 8.
struct Levels {
  double from = 0, to = 0, gain = 1;
};

// blur3() twice, but for the border, and then other levels, in one pass that rounds the result alone: what is
// dim has few levels to lose. `out` takes the size of `image`; it must not share its memory.
void blur_and_stretch(const GrayView& image, int side, const Levels& levels, GrayImage* out);

}  // namespace raysfm
