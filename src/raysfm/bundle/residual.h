#pragma once

#include <Eigen/Core>

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

// Residual of a lens, alone.
bool lens_residual(const BalLens& lens, const Eigen::Vector3d& point_in_cam, const Eigen::Vector2d& pixel,
                   Eigen::Vector2d* residual);

}  // namespace raysfm
