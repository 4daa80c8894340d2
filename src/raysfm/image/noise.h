#pragma once

#include "raysfm/image/image.h"

namespace raysfm {

// Standard deviation of the noise of an image as a part of its contrast, from a few blocks of it: where the
// image has least texture (the lower quintile of blocks) against where it has most (the upper one). The noise
// of a block is told by second differences in both directions at once, to which planes and straight edges
// along an axis are nothing (Immerkaer 1996). 0 where nothing tells it. Sharp pictures by day have at most
// 0.12, dark ones that are hardly compressed 0.3 and more.
double noise_share(const GrayView& image);

}  // namespace raysfm
