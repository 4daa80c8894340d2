#pragma once

#include <Eigen/Core>

#include "raysfm/geometry/ray.h"

namespace raysfm {

// What one match says of the length k of a translation known but for it: the Pless equation of a motion
// rig1_from_rig0 = (R, start + k direction) is offset + k slope = 0. Both are in units of length times the
// sine of the angle between the rays; a ray that is off by a small angle changes slope by at most this angle,
// and offset by the angle times the distance of the origins.
struct TranslationScale {
  double offset = 0, slope = 0;
};

// The equation of one match; the direction has unit length.
TranslationScale translation_scale(const Eigen::Matrix3d& rig1_from_rig0_rotation,
                                   const Eigen::Vector3d& start, const Eigen::Vector3d& unit_direction,
                                   const Ray& ray0, const Ray& ray1);

}  // namespace raysfm
