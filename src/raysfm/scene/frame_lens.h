#pragma once

#include <limits>
#include <optional>

#include "raysfm/camera/camera.h"
#include "raysfm/lenses/lens.h"
#include "raysfm/lenses/radial_distortion.h"

namespace raysfm {

// A lens with which one frame or more were taken.
struct FrameLens {
  Camera camera;    // rig_from_cam is the identity; width and height are 0 where nothing tells them
  double skew = 0;  // pixels; no camera model has it
  // Standard deviations of fx, fy, cx, cy and skew in pixels, and of k1 and k2; infinite where unknown.
  LensVector sigma = LensVector::Constant(std::numeric_limits<double>::infinity());
  RadialDistortion radial_sigma = {};
};

// A pinhole, or radtan where there is distortion.
FrameLens frame_lens(const Lens& lens, const RadialDistortion& radial);

// What it was made of, also where it comes from elsewhere; nullopt of other models. A camera has no skew.
std::optional<Lens> lens_of(const FrameLens& lens);
std::optional<Lens> lens_of(const Camera& camera);
RadialDistortion radial_distortion_of(const Camera& camera);  // none of other models

}  // namespace raysfm
