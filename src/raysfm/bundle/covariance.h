#pragma once

#include <Eigen/Core>
#include <vector>

#include "raysfm/bundle/bundle_problem.h"
#include "raysfm/core/result.h"

namespace raysfm {

// Covariance of what an adjustment has found: sigma2 H^-1 with H the normal equations (J^T W J) at the state
// of the problem, which should be its optimum.
//
// Gauge. Fixed poses and points hold the frame. Directions that they leave free and that no observation sees
// (translation, rotation, and the scale where no rig holds it) are found in H itself; for them H^-1 is the
// pseudo-inverse (inner constraints): the estimate is compared with the truth after the motion in these
// directions that brings them closest, in the sum of squares of the tangents of all free poses and of all
// free points, in their own units.
struct BundleCovariance {
  double sigma2 = 0;       // variance of one component of a residual, in its unit squared
  int gauge_freedoms = 0;  // 0 to 7: free directions, see above
  // By pose: of the tangent (v, w) of rig_from_world (geometry/pose.h); zero for poses that are not free, NaN
  // for those that the observations do not hold.
  std::vector<Eigen::Matrix<double, 6, 6>> poses;
  // By point, world axes; zero for fixed points, NaN where the rays that see the point are (nearly) one.
  std::vector<Eigen::Matrix3d> points;
};

// `known_sigma` > 0 is the standard deviation of one component of a residual; 0: estimated from the
// residuals, as twice the cost over the degrees of freedom. Lenses are unknowns too, but their covariance is
// not given. kBadInput for a contradictory problem; kNoReconstruction where nothing moves, where there are no
// more observations than unknowns (and no known sigma), or where the observations leave more than the gauge
// free.
Result<BundleCovariance> bundle_covariance(const BundleProblem& problem, const BundleOptions& options,
                                           double known_sigma = 0);

}  // namespace raysfm
