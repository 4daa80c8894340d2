#pragma once

#include "raysfm/ray_lenses/ray_reconstruction.h"

namespace raysfm {

// Reconstructs photos of one perspective lens that is not known from guesses of its focal length, one after
// the other, and of `focal`, pixels, first where that is above 0; until two guesses lead to the same lens and
// about as many photos. The one that poses most photos, of equal ones that with which most observations
// agree; nothing where less than half of them agree. Photos that zoom have a reconstruction with one lens too
// as long as they are alike enough: it is for the caller to ask which of the two they are.
RayReconstruction reconstruct_photos_of_one_lens(const PointTracks& tracks, double focal,
                                                 const RayOptions& options);

}  // namespace raysfm
