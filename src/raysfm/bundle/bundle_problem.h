#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>

#include "raysfm/camera/camera.h"
#include "raysfm/geometry/pose.h"
#include "raysfm/optim/levenberg_marquardt.h"
#include "raysfm/optim/robust_loss.h"

namespace raysfm {

// A point seen at a pixel. Indices into the spans of BundleProblem.
struct BundleObservation {
  int pose = 0;
  int point = 0;
  int camera = 0;
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();  // pixels
};

// A bundle adjustment over flat arrays owned by the caller (LBA09 2.5, IFBA01 2). Poses and points are
// refined in place. Observations may come in any order, and a pose may see a point more than once (a rig).
// Poses that are not free are observed but stay where they are.
struct BundleProblem {
  std::span<const Camera> cameras;
  std::span<Rigid3> rig_from_world;
  std::span<const uint8_t> pose_is_free;    // one per pose; empty: all free
  std::span<Eigen::Vector3d> points;        // world
  std::span<const uint8_t> point_is_fixed;  // one per point; empty: none fixed
  std::span<const BundleObservation> observations;
  std::span<uint8_t> is_inlier;  // one per observation, 0: not used; empty: all used
};

struct BundleOptions {
  RobustLoss loss = {};     // of the residual in pixels
  int max_iterations = 10;  // of each run, at least 1
  double min_relative_decrease = 1e-6;
  double initial_damping = 1e-4;
};

// Costs are half the sum of rho(|residual|^2), pixels squared, over the observations in use.
struct BundleSummary {
  double initial_cost = 0;
  double final_cost = 0;
  int iterations = 0;
  Termination termination = Termination::kNothingToDo;
  int used_observations = 0;     // in the final cost
  int dropped_observations = 0;  // inliers whose point does not project, at the start or later
  double solve_ms = 0;
};

}  // namespace raysfm
