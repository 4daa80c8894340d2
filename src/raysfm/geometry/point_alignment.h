#pragma once

#include <Eigen/Core>
#include <vector>

#include "raysfm/geometry/pose.h"

namespace raysfm {

// b_from_a of least squares from corresponding points, without those that are far off in a or b and those
// that fit much worse than the others. Without scale it is a rigid motion. The identity where fewer than
// three are left, or they tell nothing.
Similarity3 align_points(std::vector<Eigen::Vector3d> a, std::vector<Eigen::Vector3d> b, bool with_scale);

}  // namespace raysfm
