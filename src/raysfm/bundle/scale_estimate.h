#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "raysfm/bundle/bundle_problem.h"

namespace raysfm {

// What the observations say of the scale of a world: that of the trajectory, as a similarity fits it.
struct ScaleEstimate {
  double ratio =
      1;  // of the scale of least cost to the present one, everything else adjusted; within [1/1000, 4]
  double sigma = 0;  // standard deviation of the logarithm of the former
  double alike =
      1;  // how many times the variance of independent errors it has, as those of a point are alike
};

// Holds the scale where it is: the present distance of the pose farthest from the first that is not free. No
// prior (pose -1) where every pose is free or none is elsewhere.
ScalePrior hold_present_scale(const BundleProblem& problem, double weight);

// From one linearisation of a problem of cameras or rays at a state near its minimum, but for the scale: seen
// along rays of different origins, the residuals are nearly linear in the inverse of the scale, so that the
// state may be at a multiple of it. One pose at least must not be free, and no point fixed;
// problem.scale_prior is not looked at. The standard deviation is that of the normal equations with the
// variance of the residuals, or of the gradient's parts by point where errors of one point's observations go
// together, whichever is more. Nothing where no observation tells the scale, as with a central camera.
// `by_residual`, where it is not null: how the logarithm of the scale of least cost changes with each
// residual, by observation; zero of those that are not used.
std::optional<ScaleEstimate> estimate_scale(const BundleProblem& problem, const BundleOptions& options,
                                            std::vector<Eigen::Vector2d>* by_residual = nullptr);

}  // namespace raysfm
