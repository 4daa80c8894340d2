#pragma once

#include "raysfm/ray_lenses/ray_reconstruction.h"

namespace raysfm {

// Reconstructs photos of one perspective lens that is not known from guesses of its focal length, one after
// the other, and of `focal`, pixels, first where that is above 0. The one that poses most photos, of equal
// ones that with which most observations agree; one guess that poses all of them is enough where more than
// `enough` observations agree. Guesses that are too long come out right, to 1.6 times at least; those that
// are too short by a sixth do not.
RayReconstruction reconstruct_photos_of_one_lens(const PointTracks& tracks, double focal, int enough,
                                                 const RayOptions& options);

}  // namespace raysfm
