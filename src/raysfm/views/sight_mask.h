#pragma once

#include "raysfm/camera/camera.h"
#include "raysfm/image/image.h"

namespace raysfm {

// Narrows a mask (255 where a pixel sees the scene; empty: everywhere) to the pixels that have a ray, and
// whose patch has: the border of a fisheye's disc would be full of corners that move with the camera. Empty
// where nothing is left out.
GrayImage sight_mask(const Camera& camera, GrayImage mask);

}  // namespace raysfm
