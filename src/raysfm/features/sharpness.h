#pragma once

#include "raysfm/image/image.h"

namespace raysfm {

// Width of the sharper edges of an image: the standard deviation, in pixels, of the Gaussian blur that would
// make of a step what the lower quartile of the edges with a good contrast are. 0.4 to 0.8 where a camera's
// pixels are used to the full, larger by the factor of an enlargement, sqrt(w^2 + s^2) after a blur by s. 0
// where too few edges tell it. Looks at a few rows and columns, so that it costs little at any size.
float edge_width(const GrayView& image);

}  // namespace raysfm
