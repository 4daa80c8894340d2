#pragma once

#include <Eigen/Core>
#include <span>

#include "raysfm/bundle/bundle_problem.h"
#include "raysfm/views/tracking_rig.h"

namespace raysfm {

// What the errors of a calibration do to the scale of a map that was adjusted with it: the standard deviation
// of its logarithm that they make. `problem`: of the cameras or rays of `rig`; `by_residual`: of
// estimate_scale() of it. `deviations`: how well the calibration is known, as of window_covariance().
double scale_sigma_by_calibration(const BundleProblem& problem, std::span<const Eigen::Vector2d> by_residual,
                                  const TrackingRig& rig, std::span<const Rig> deviations);

}  // namespace raysfm
