#pragma once

#include <optional>
#include <span>

#include "raysfm/geometry/pose.h"

namespace raysfm {

// Drift as the KITTI odometry benchmark defines it: the error of the motion over stretches of 100, 200, ...,
// 800 m of true path, started at every tenth pose, divided by the length of the stretch and averaged over all
// stretches.
struct KittiDrift {
  double t_rel_percent = 0;
  double r_rel_deg_per_100m = 0;
  int stretches = 0;  // that were averaged
};

// Poses of equal index belong together; the estimate has the scale of the truth. `path` is the length in
// metres of the true path up to each pose. Empty where the path has no stretch of 100 m.
std::optional<KittiDrift> kitti_drift(std::span<const Rigid3> estimate, std::span<const Rigid3> truth,
                                      std::span<const double> path);

}  // namespace raysfm
