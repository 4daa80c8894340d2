#pragma once

#include <optional>

#include "raysfm/camera/camera.h"

namespace raysfm::synth {

// Focal lengths and principal point of a camera, pixels.
struct Lens {
  double fx = 0, fy = 0, cx = 0, cy = 0;
};

// Nothing where the camera's model has no parameters of these names.
std::optional<Lens> lens_of(const Camera& camera);

// The camera with other focal lengths and all else the same, its distortion too. lens_of(camera) must exist.
Camera with_focal_lengths(Camera camera, double fx, double fy);

// Factor of the focal length at `part` in [0, 1] of a zoom from 1 to `last`: geometric, with a gentle start
// and end.
double zoom_factor(double last, double part);

}  // namespace raysfm::synth
