#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "raysfm/bundle/bundle_problem.h"

namespace raysfm {

// Residual of one observation of a valid problem over its standard deviation, with this pose, lens (looked at
// where the problem has lenses) and point in place of the problem's. False, leaving `residual` unspecified,
// where there is none: the point is behind the camera or outside the valid set of its model, or something is
// not finite.
bool residual_of(const BundleProblem& problem, int observation, const Rigid3& rig_from_world,
                 const BalLens& lens, const Eigen::Vector3d& point, Eigen::Vector2d* residual);

// With the problem's own.
bool residual_of(const BundleProblem& problem, int observation, Eigen::Vector2d* residual);

// The same for many observations of a problem that stays as it is: what depends on poses and cameras alone is
// worked out once. Memory only grows.
class ProblemResiduals {
 public:
  void load(const BundleProblem& problem);
  bool operator()(int observation, Eigen::Vector2d* residual) const;

 private:
  struct Frame {  // from the world
    Eigen::Matrix3d rotation;
    Eigen::Vector3d translation;
  };
  BundleProblem problem_;
  size_t cameras_ = 1;         // frames of each pose
  std::vector<Frame> frames_;  // by pose, then by camera
};

// Sum of the squared residuals of all observations, whatever is_inlier says. One that is longer than `most`,
// or that there is none of, costs as much as one of that length.
double truncated_cost(const BundleProblem& problem, double most);

// Standard deviation of the residuals of the observations in use, from their median (that of the squared
// length of two normal numbers is 2 ln 2); 0 where there are none.
double noise_of(const BundleProblem& problem);

// Huber's loss as wide as suits that noise. Matches that are wrong by less than an inlier may be pull at a
// map as hard as a loss of a whole pixel lets them, beside a noise of a tenth of one.
RobustLoss loss_for_noise(const BundleProblem& problem);
// The same by Tukey's: beyond it nothing counts.
RobustLoss redescending_loss_for_noise(const BundleProblem& problem);

// Residual of a lens, alone.
bool lens_residual(const BalLens& lens, const Eigen::Vector3d& point_in_cam, const Eigen::Vector2d& pixel,
                   Eigen::Vector2d* residual);

}  // namespace raysfm
