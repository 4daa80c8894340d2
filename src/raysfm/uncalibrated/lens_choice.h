#pragma once

#include <cstdint>
#include <span>

#include "raysfm/core/result.h"
#include "raysfm/uncalibrated/reconstruct.h"

namespace raysfm {

// Which of two reconstructions of the same tracks to believe, `fixed` with one lens for all images or `zoom`
// with one for each; the one that there is where only one is, with the error of `fixed` where none is. Says
// why in lens_evidence. `compared`: one mark for each image, whether its observations are looked at.
//
// A lens for each image adds three numbers to each. They must lower the sum of squares, each at most that of
// max_error_px, in units of the variance of the residuals, by four standard deviations more than as many
// superfluous numbers would (chi-squared). Errors that are alike along a track lower it too: there it must
// fall by what the Bayesian information criterion asks for, and the focal length must change by more than
// such errors bring about, or the residuals fall by what they cannot; and change in the images whose
// residuals fall. Errors that are alike in an image lower it by a few percent, and matches that are wrong by
// far more in a few images: there the rms of most images must fall by an eighth, and the focal length
// change.
Result<UncalibratedReconstruction> choose_lens(const PointTracks& tracks, std::span<const uint8_t> compared,
                                               Result<UncalibratedReconstruction> fixed,
                                               Result<UncalibratedReconstruction> zoom, double max_error_px,
                                               ErrorRelation errors);

// Adjusts a reconstruction with a lens for each image again with one lens for all images of one number of
// options.lens_of_image, and takes that where choose_lens() finds nothing that speaks for more of them: says
// so in lens_evidence, either way. Without numbers, or with one lens for all images, nothing changes.
void share_lenses(const PointTracks& tracks, const SolveOptions& options, UncalibratedReconstruction* result);

// Root mean square error of the observations marked, pixels; 0 without any.
double rms_error(const PointTracks& tracks, const UncalibratedScene& scene, const RadialDistortion& radial,
                 std::span<const uint8_t> marked);

}  // namespace raysfm
