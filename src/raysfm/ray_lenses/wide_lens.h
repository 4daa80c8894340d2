#pragma once

#include <optional>
#include <span>
#include <string>

#include "raysfm/lenses/uncalibrated_scene.h"
#include "raysfm/ray_lenses/ray_reconstruction.h"

namespace raysfm {

// A reconstruction of tracks through one perspective lens. Borrows all of it.
struct PerspectiveFit {
  const UncalibratedScene& scene;  // all lenses are the same
  RadialDistortion radial;
  std::span<const uint8_t> image_posed, point_placed, inlier;  // one per image, point, observation
};

// What else than a perspective lens the images may have been taken with.
struct WideLensSearch {
  bool compared = false;                   // another lens was found, and compared with the perspective one
  std::optional<RayReconstruction> found;  // the other, where it is surely better
  std::string evidence;                    // one line; empty where nothing was compared
};

// Whether a perspective lens looks like one that is none: wide, or images bent inwards at their corners more
// than k1 and k2 are good for.
bool may_be_wide_lens(const PointTracks& tracks, const PerspectiveFit& perspective);

// Fits lenses of other models (fisheyes) to the tracks of a video. One is surely better than a perspective
// lens where it bends images as none does, its focal length is known within 2 %, it poses as many images and,
// over the observations of points that both place, lowers the sum of squared errors by more than the Bayesian
// information criterion asks for, and the rms by a twentieth: errors that are alike along tracks lower the
// sum too. Where no perspective lens was found (null) it must pose most images.
// Of many observations it looks at those of a part of the points only, and so does the result.
WideLensSearch find_wide_lens(const PointTracks& tracks, const PerspectiveFit* perspective,
                              const RayOptions& options);

}  // namespace raysfm
