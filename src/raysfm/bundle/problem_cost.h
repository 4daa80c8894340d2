#pragma once

#include "raysfm/bundle/bundle_problem.h"

namespace raysfm {

struct ProblemCost {
  double cost = 0;  // half the sum of rho(|r|^2) over the inliers that have a residual
  int used = 0;
  int dropped = 0;  // inliers without a residual
};

// Of a valid problem as it stands.
ProblemCost problem_cost(const BundleProblem& problem, const RobustLoss& loss);

// Whether the observations tell how large the scene is: scaling poses and points together then changes them,
// as with cameras of a rig that are apart.
bool scale_is_observed(const BundleProblem& problem);

}  // namespace raysfm
