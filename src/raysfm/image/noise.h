#pragma once

#include "raysfm/image/image.h"

namespace raysfm {

// What the grey levels of an image are made of, from a few blocks of it; all 0 where nothing tells it.
struct Grain {
  // Standard deviation of the noise where there is least of it (the lower quintile of blocks), by second
  // differences in both directions at once, to which planes and straight edges along an axis are nothing
  // (Immerkaer 1996). What an encoder has smoothed is not seen.
  double noise = 0;
  double contrast = 0;  // standard deviation where the image has most texture: the upper quintile
  double mean = 0;
};
Grain grain_of(const GrayView& image);

// Makes of an image in which corners would be those of the noise, and patches of one place unlike, one that
// can be followed: blurred by up to a pixel, the more the larger a part of its contrast is noise, and
// stretched where it is dim. Both grow continuously, so that successive images stay alike. Other images stay
// as they are.
void subdue_noise(GrayImage* image);

}  // namespace raysfm
