#pragma once

namespace raysfm {

// Lens of one image in the form of Bundle Adjustment in the Large (Agarwal et al. 2010): the camera looks
// along -z; with p = -(x, y) / z the pixel is f (1 + k1 |p|^2 + k2 |p|^4) p, counted from the principal
// point, x to the right, y up. A point with z >= 0 is behind the camera.
struct BalLens {
  double f = 1;  // pixels
  double k1 = 0, k2 = 0;
};

}  // namespace raysfm
