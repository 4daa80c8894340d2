#pragma once

#include <Eigen/Core>

#include "raysfm/geometry/ray.h"

namespace raysfm {

// Length of a translation known but for it, from one match: the Pless equation of a motion
// rig1_from_rig0 = (R, start + k direction) is linear in k. The lines of the two rays then meet, maybe behind
// an origin. False where k does not matter to them: rays that are parallel or in one plane with the
// direction.
bool translation_scale(const Eigen::Matrix3d& rig1_from_rig0_rotation, const Eigen::Vector3d& start,
                       const Eigen::Vector3d& unit_direction, const Ray& ray0, const Ray& ray1,
                       double* scale);

}  // namespace raysfm
