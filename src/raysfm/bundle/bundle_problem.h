#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>

#include "raysfm/camera/camera.h"
#include "raysfm/camera/observed_ray.h"
#include "raysfm/geometry/pose.h"
#include "raysfm/optim/levenberg_marquardt.h"
#include "raysfm/optim/robust_loss.h"
#include "raysfm/residuals/bal_lens.h"

namespace raysfm {

// A point seen at a pixel. Indices into the spans of BundleProblem.
struct BundleObservation {
  int pose = 0;
  int point = 0;
  int camera = 0;
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();  // pixels
};

// What is believed of the scale of a world that its observations hardly tell, so that it cannot drift along a
// flat valley (rays of a mirror nearly meet in a point): adds weight / 2 log^2(|c - c0| / distance) to the
// cost, c and c0 the origins of the rigs at `pose` and `from`. `from` must not be free; distance > 0.
struct ScalePrior {
  int pose = -1;  // -1: no prior
  int from = 0;
  double distance = 1;
  double weight = 0;  // in the residual's unit squared
};

// A bundle adjustment over flat arrays owned by the caller (LBA09 2.5, IFBA01 2). Poses and points are
// refined in place. Observations may come in any order, and a pose may see a point more than once (a rig).
// Poses that are not free are observed but stay where they are.
//
// The error of an observation is
//   pixel     where `rays` and `lenses` are empty: predicted minus observed pixel of the named camera;
//   angular   where `rays` is not empty: that of LBA09 3.2, rays[i] is the ray of observations[i] in the
//             rig's frame. Neither the pixel nor the camera is looked at. Its unit is that of
//             ObservedRay::tangents: tangents of angles, or pixels when whitened;
//   lens      where `lenses` is not empty: predicted minus observed pixel of the pose's own lens, which is
//             refined with the pose: nine unknowns for each free pose. The camera is not looked at; `rays`
//             must be empty.
// Where `sigmas` is not empty, every error is divided by its standard deviation: losses, costs, thresholds
// and covariances then count standard deviations.
struct BundleProblem {
  std::span<const Camera> cameras;
  std::span<Rigid3> rig_from_world;
  std::span<const uint8_t> pose_is_free;    // one per pose; empty: all free
  std::span<Eigen::Vector3d> points;        // world
  std::span<const uint8_t> point_is_fixed;  // one per point; empty: none fixed
  std::span<const BundleObservation> observations;
  std::span<uint8_t> is_inlier;            // one per observation, 0: not used; empty: all used
  std::span<const ObservedRay> rays = {};  // one per observation, or empty
  std::span<BalLens> lenses = {};          // one per pose, or empty
  std::span<const float> sigmas = {};      // > 0, in the residual's unit; one per observation; empty: all 1
  ScalePrior scale_prior = {};

  bool uses(size_t observation) const { return is_inlier.empty() || is_inlier[observation] != 0; }
};

struct BundleOptions {
  RobustLoss loss = {};     // of the residual, in its unit
  int max_iterations = 10;  // of each run, at least 1
  double min_relative_decrease = 1e-6;
  double initial_damping = 1e-4;
  // Above 0, after every step of the poses (by a loss that redescends: of poses that are near), the points
  // that still move are brought to rest with the poses held, and it ends with a step of the poses that is,
  // all in all, at most so many standard deviations long (of what the residuals tell of them). A robust loss
  // has points next to wrong matches come to rest over dozens of steps while no pose moves any more. The
  // final cost is that before the last steps of the points.
  double settled = 0;
  int threads = 1;                 // at least 1; the result does not depend on it
  ProgressCallback progress = {};  // called after every linear solve; false: stop with what is reached
};

// Costs are half the sum of rho(|residual|^2), in the residual's unit squared, over the observations in use.
struct BundleSummary {
  double initial_cost = 0;
  double final_cost = 0;
  int iterations = 0;
  Termination termination = Termination::kNothingToDo;
  int used_observations = 0;     // in the final cost
  int dropped_observations = 0;  // inliers without a residual (behind the camera), at the start or later
  double solve_ms = 0;
};

}  // namespace raysfm
