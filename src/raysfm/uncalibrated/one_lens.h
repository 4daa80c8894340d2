#pragma once

#include <cstdint>
#include <span>

#include "raysfm/core/result.h"
#include "raysfm/lenses/lens_adjustment.h"
#include "raysfm/uncalibrated/reconstruct.h"

namespace raysfm {

// The numbers of a lens and its distortion: fx, fy, cx, cy, skew, k1, k2.
using LensNumbers = Eigen::Matrix<double, 7, 1>;

// One lens for all images, adjusted together with its distortion.
struct OneLens {
  UncalibratedScene scene;
  RadialDistortion radial;
  int terms = 0;  // coefficients of it that are unknowns
  LensAdjustmentSummary adjustment;
  LensNumbers sigma = LensNumbers::Zero();  // standard deviations
};

// Adjusts poses, points, one lens and so many coefficients of its distortion, k1 before k2, from `start`, by
// the observations marked `used`. Corners followed through a video are mostly right to a tenth of a pixel and
// now and then wrong by pixels, all of a track together: the weights of the tracks are those of Student's
// distribution, one scale for each track, its width found from the residuals; first from those of the start
// with all of its distortion, so that weights and not the lens begin with what is no unknown.
//
// The standard deviations are those of the influences of independent groups of observations: tracks, or all
// tracks that begin in one image and live through the same images, whichever is more. Errors along a track,
// which are alike, do not count as many.
Result<OneLens> adjust_one_lens(const PointTracks& tracks, std::span<const uint8_t> used,
                                const SolveOptions& options, int radial_terms, const UncalibratedScene& start,
                                const RadialDistortion& radial = {});

// Adds to the standard deviations, in squares, by how much the lens is another where single observations and
// not tracks are judged, by Huber's loss. Where the model holds both find the same lens but for noise; what
// is between them tells of errors that are no noise (Hausman, Econometrica 46(6), 1978).
Result<void> widen_by_other_weights(const PointTracks& tracks, std::span<const uint8_t> used,
                                    const SolveOptions& options, OneLens* lens);

// Both in turn.
Result<OneLens> adjust_one_lens_widened(const PointTracks& tracks, std::span<const uint8_t> used,
                                        const SolveOptions& options, int radial_terms,
                                        const UncalibratedScene& start, const RadialDistortion& radial = {});

// The same with as many coefficients as the images tell, by these standard deviations. What a coefficient
// that they do not tell would change of the lens is in its standard deviations.
Result<OneLens> adjust_one_lens_as_told(const PointTracks& tracks, std::span<const uint8_t> used,
                                        const SolveOptions& options, const UncalibratedScene& start,
                                        const RadialDistortion& radial = {});

// As the options want the distortion.
Result<OneLens> adjust_one_lens_to_the_end(const PointTracks& tracks, std::span<const uint8_t> used,
                                           const SolveOptions& options, const UncalibratedScene& start,
                                           const RadialDistortion& radial);

// Adds half a percent to the standard deviations of the focal lengths, in squares: a rolling shutter, blur,
// and what a model does not describe of a lens are the same for all points, so that no spread tells of them.
void add_model_error(UncalibratedReconstruction* result);

// Whether the reconstruction ends with the adjustment of one lens.
bool adjusts_one_lens(const SolveOptions& options, const UncalibratedReconstruction& result);

// Puts the lens with its standard deviations into the reconstruction, and marks the observations of the
// `judged` images (1; one per image) that agree with it, and the points that have enough of them.
void take_lens(const PointTracks& tracks, std::span<const uint8_t> judged, const SolveOptions& options,
               OneLens lens, UncalibratedReconstruction* result);

}  // namespace raysfm
