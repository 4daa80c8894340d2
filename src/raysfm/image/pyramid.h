#pragma once

#include <vector>

#include "raysfm/image/image.h"

namespace raysfm {

// Mean of each 2 x 2 block, rounded to nearest, halves up. `half` is (image.width / 2) x (image.height / 2);
// an odd last row or column is left out. Pixel x of `half` is at 2 x + 0.5 in `image`.
void half_sample(const GrayView& image, GrayImage* half);

// Levels of a pyramid below an image: level 1 first, each the half_sample() of the one before.
// `levels` >= 0; stops early where a side would fall below 16 pixels. Reuses the memory of `pyramid`.
void make_pyramid(const GrayView& image, int levels, std::vector<GrayImage>* pyramid);

// Mean of square blocks of a power of two pixels, the smallest for which the width is at most `max_width`.
// Returns the side of a block: pixel x of `thumbnail` is at (x + 0.5) * side - 0.5 in `image`.
int make_thumbnail(const GrayView& image, int max_width, GrayImage* thumbnail);

}  // namespace raysfm
