#pragma once

#include <span>
#include <vector>

#include "raysfm/core/result.h"
#include "raysfm/eval/trajectory_error.h"
#include "raysfm/geometry/pose.h"
#include "raysfm/geometry/trajectory.h"

namespace raysfm {

// How the errors of positions, or of orientations, compare with what their covariances say.
struct Consistency {
  // Part of the frames whose error e lies within the 90 % ellipsoid: e^T C^-1 e <= 6.25, three degrees of
  // freedom. A frame whose covariance is not positive definite is not within.
  double held = 0;
  // Sum of e^T C^-1 e over the degrees of freedom that the alignments leave: 1 where covariances are right.
  // Without the frames whose covariance is not positive definite.
  double normalised_error2 = 0;
};

// Over stretches of so many consecutive matched frames, each aligned by itself; they do not overlap.
struct WindowConsistency {
  int length = 0;   // frames of a window
  int windows = 0;  // 0: there are fewer frames than that, and nothing else is told
  int frames = 0;   // length * windows
  Consistency position, orientation;
};

// Compares errors with the covariances of the poses of the estimate: of the tangent (v, w) of world_from_rig
// in the world's axes (docs/conventions.md), one for each pose. A covariance says how far off a pose is with
// respect to those about it, which is why each window is aligned by itself: positions as options.alignment
// says, orientations by the rotation that takes them nearest to the true ones (not at all for kNone).
//
// One entry for each length. Errors: bad input, where there are not as many covariances as poses, or a length
// is below four, which an alignment would fit.
Result<std::vector<WindowConsistency>> window_consistency(const Trajectory& estimate,
                                                          std::span<const Matrix6d> covariances,
                                                          const Trajectory& truth,
                                                          const EvaluationOptions& options,
                                                          std::span<const int> lengths);

}  // namespace raysfm
