#pragma once

#include <span>
#include <vector>

#include "raysfm/core/result.h"
#include "raysfm/lenses/lens_constraints.h"
#include "raysfm/lenses/point_tracks.h"
#include "raysfm/lenses/radial_distortion.h"
#include "raysfm/lenses/uncalibrated_scene.h"
#include "raysfm/optim/levenberg_marquardt.h"
#include "raysfm/optim/robust_loss.h"

namespace raysfm {

// How the constraints on the lenses are imposed (IFBA01 4.3); of the intrinsics-free adjustment alone, the
// standard one has them in its parameters.
enum class ConstraintMethod { kWeights, kLagrange };

// Where the intrinsics-free residual is taken: pixels (equation 12), or the space invariant to intrinsics.
enum class CostSpace { kImage, kInvariant };

// How the intrinsics-free adjustment has the lenses follow from poses and points.
enum class LensEstimate {
  kMoments,       // K = T_p T_m^-1 (IFBA01 equation 10): the constraints are further residuals
  kLeastSquares,  // those that fit best and meet the constraints: the minimum is that of adjust_standard()
};

// How a scene with unknown lenses is adjusted.
struct LensAdjustmentOptions {
  LensConstraints constraints;
  LensEstimate estimate = LensEstimate::kMoments;  // of the intrinsics-free adjustment
  // The next three are of kMoments alone.
  ConstraintMethod method = ConstraintMethod::kWeights;
  CostSpace space = CostSpace::kImage;
  // Weight of an exact constraint, relative to what the moments of an image say of the number: see
  // constraint_rows(); > 0. With multipliers it is the price of a violation when a step is judged.
  double constraint_weight = 1;
  // Of the standard adjustment alone: the distortion of all images, and how many of its coefficients, k1
  // before k2, are unknowns: 0 to 2, and 0 unless the lenses are equal.
  RadialDistortion radial;
  int radial_terms = 0;
  // Of unknown lenses in the standard adjustment alone: numbers of the lenses that images were taken with, by
  // image of the tracks; images of one number have the same lens. Empty: each image has its own, or all have
  // one.
  std::span<const int> lens_of_image = {};
  RobustLoss loss;              // scale in pixels
  int reweightings = 3;         // rounds with the weights of the loss held fixed; one when there is no loss
  bool with_sigma = true;       // compute lens_sigma
  bool with_influence = false;  // compute influence
  int threads = 1;              // > 0; never changes a result
  LmOptions lm{.max_iterations = 100, .min_relative_decrease = 1e-6, .initial_damping = 1e-3};
};

struct LensAdjustmentSummary {
  LmSummary lm;  // of the last round; iterations are of all rounds
  // 1/2 sum of squared residuals and constraints after so many linear solves, of the last round; the first is
  // that of the start.
  std::vector<double> costs;
  double rms_px = 0;  // root mean square distance between prediction and observation, used ones
  int used = 0;       // observations used
  int dropped = 0;    // not used: weight 0, behind the camera, or of an image or point seen too little
  // Standard deviation of each number of each lens, pixels, scaled by the residuals; infinite where the
  // constraints leave the number free. Empty unless asked for.
  std::vector<LensVector> lens_sigma;
  RadialDistortion radial;  // what became of that of the options
  // How much the observations of each point of the tracks move the one lens of the standard adjustment, to
  // first order: fx, fy, cx, cy, skew, k1, k2 in a column. Points are independent of one another where
  // observations are not, so that the sum of the squares is their variance. Empty unless asked for.
  Eigen::Matrix<double, 7, Eigen::Dynamic> influence;
};

// An observation of an image with fewer than this many is not used: 11 numbers, two from each point.
inline constexpr int kMinPointsPerImage = 6;

// Intrinsics-free bundle adjustment (IFBA01 sections 3, 4). By moments, the lenses in `scene` are not read;
// they are written a posteriori. `weights`: empty, or one >= 0 for each observation; 0 leaves it out.
// kBadInput: tracks and scene do not fit together, numbers not finite, fewer images than the constraints
// need.
Result<LensAdjustmentSummary> adjust_intrinsics_free(const PointTracks& tracks,
                                                     std::span<const double> weights,
                                                     const LensAdjustmentOptions& options,
                                                     UncalibratedScene* scene);

// Standard bundle adjustment: the numbers of the lenses that the constraints leave free are unknowns, one
// set for all images or one for each.
Result<LensAdjustmentSummary> adjust_standard(const PointTracks& tracks, std::span<const double> weights,
                                              const LensAdjustmentOptions& options, UncalibratedScene* scene);

// Intrinsics-free by moments, and from where that comes to gain little, by least squares: the minimum of
// adjust_standard() in as few steps as by moments. Costs and sigmas are those of the second.
Result<LensAdjustmentSummary> adjust_polished(const PointTracks& tracks, std::span<const double> weights,
                                              const LensAdjustmentOptions& options, UncalibratedScene* scene);

}  // namespace raysfm
