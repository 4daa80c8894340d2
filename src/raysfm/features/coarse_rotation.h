#pragma once

#include <Eigen/Core>

#include "raysfm/image/image.h"

namespace raysfm {

// Motion of the whole image between two frames, as a small rotation of the camera causes it: with c the
// centre of the image, a pixel at p in the first is at c + R(angle) (p - c) + shift in the second.
struct CoarseMotion {
  Eigen::Vector2f shift = Eigen::Vector2f::Zero();  // pixels of the full-size image
  float angle = 0;                                  // radians, positive from the u axis to the v axis
  float zncc = 0;  // of the overlap after alignment; below about 0.5: no trust

  // Place in the second image of a pixel of the first, both of `width` x `height` pixels.
  Eigen::Vector2f apply(const Eigen::Vector2f& pixel, int width, int height) const;
};

// `first` and `second` are thumbnails of equal size (image/pyramid.h, make_thumbnail), 32 to 256 pixels wide.
// `scale`: pixels of the full-size image per pixel of the thumbnail. Shifts of up to a quarter of the image
// are searched. zncc = 0 where nothing was found.
CoarseMotion estimate_coarse_motion(const GrayView& first, const GrayView& second, float scale);

}  // namespace raysfm
