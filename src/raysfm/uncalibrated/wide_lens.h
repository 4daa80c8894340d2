#pragma once

#include <optional>
#include <string>

#include "raysfm/uncalibrated/ray_reconstruction.h"
#include "raysfm/uncalibrated/reconstruct.h"

namespace raysfm {

// What else than a perspective lens the images may have been taken with.
struct WideLensSearch {
  bool compared = false;                   // another lens was found, and compared with the perspective one
  std::optional<RayReconstruction> found;  // where that explains the tracks surely better
  std::string evidence;                    // one line; empty where nothing was compared
};

// Whether a perspective lens looks like one that is none: wide, or images bent inwards at their corners more
// than k1 and k2 are good for.
bool may_be_wide_lens(const PointTracks& tracks, const UncalibratedReconstruction& perspective);

// Fits lenses of other models (fisheyes) to the tracks of a video that reconstruct_video() has found one
// perspective lens for. One is taken where it poses as many images and, over the observations of points that
// both place, lowers the sum of squared errors by more than the Bayesian information criterion asks for, and
// the rms by a twentieth: errors that are alike along tracks lower the sum too.
WideLensSearch find_wide_lens(const PointTracks& tracks, const SolveOptions& options,
                              const UncalibratedReconstruction& perspective, int threads);

}  // namespace raysfm
