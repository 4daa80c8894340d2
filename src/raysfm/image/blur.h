#pragma once

#include "raysfm/image/image.h"

namespace raysfm {

// Binomial filter [1 2 1]/4 in both directions (sigma 0.71 pixels), rounded to nearest; pixels outside repeat
// the border. `out` takes the size of `image`; it must not share its memory.
void blur3(const GrayView& image, GrayImage* out);

}  // namespace raysfm
