#pragma once

#include "raysfm/image/image.h"

namespace raysfm {

constexpr int kBinomial = 64;  // side of blur3()

// Filter [s, 256 - 2 s, s] / 256 in both directions, s = `side` in 0 to 64, rounded to nearest; its variance
// is s / 128 square pixels. kBinomial is [1 2 1] / 4 (sigma 0.71 pixels). Pixels outside repeat the border.
// `out` takes the size of `image`; it must not share its memory.
void blur3(const GrayView& image, int side, GrayImage* out);

}  // namespace raysfm
