#pragma once

#include <optional>
#include <span>
#include <vector>

#include "raysfm/geometry/pose.h"
#include "raysfm/optim/robust_loss.h"
#include "raysfm/scene/map.h"
#include "raysfm/scene/reconstruction.h"
#include "raysfm/views/tracking_rig.h"

namespace raysfm {

// What the errors of a map, and those of the calibration, do to the poses of consecutive key frames of it.
struct WindowCovariance {
  // By key frame, of the tangent of rig_from_world: `variance` times the inverse of the normal equations of
  // all poses and points of the window, points eliminated. The first block is about positions after the
  // similarity (the rigid motion where the scale is metric) that takes those of the window nearest to the
  // true ones, the last about orientations after the rotation that does so.
  std::vector<Matrix6d> poses;
  std::vector<Matrix6d> by_calibration;  // likewise, what a wrong calibration adds
  // Of one component of a residual, standard deviations of the octave squared. The first counts that
  // errors are alike in points of one neighbourhood, in all key frames; the second does not.
  double variance = 0, independent_variance = 0;
};

// Of key frames [first, end) of a map, at least two, by at most `most_points` points; `loss` of residuals
// in standard deviations. `deviations`: calibrations of the rig's cameras that are a standard deviation off
// each, in directions that are independent of one another; empty: the rig's is exact. Nothing where they do
// not hold together by their points.
std::optional<WindowCovariance> window_covariance(const TrackingRig& rig, const Map& map, int first, int end,
                                                  const RobustLoss& loss, int most_points,
                                                  std::span<const Rig> deviations = {});

}  // namespace raysfm
