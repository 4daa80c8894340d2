#pragma once

#include "raysfm/uncalibrated/reconstruct.h"

namespace raysfm {

// Adjusts a reconstruction with a lens for each image again with one lens for all images of one number of
// options.lens_of_image, and takes that where choose_lens() finds nothing that speaks for more of them: says
// so in lens_evidence, either way. Without numbers, or with one lens for all images, nothing changes.
void share_lenses(const PointTracks& tracks, const SolveOptions& options, UncalibratedReconstruction* result);

}  // namespace raysfm
