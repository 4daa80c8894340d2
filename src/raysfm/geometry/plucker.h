#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "raysfm/geometry/ray.h"

namespace raysfm {

// Plücker coordinates of a line with LBA09 4.1's sign of the moment: q' = q x P for every point P on it.
struct PluckerLine {
  Eigen::Vector3d direction;  // q, unit length for a ray's line
  Eigen::Vector3d moment;     // q'
};

inline PluckerLine plucker_line(const Ray& ray) {
  return {ray.direction, ray.direction.cross(ray.origin)};
}

// Generalised epipolar constraint or Pless equation (LBA09 4.2, equation 1), where the pose of rig 1 in the
// frame of rig 0 is (R, t): q0'^T R q1 - q0^T [t]x R q1 + q0^T R q1'. Zero where the two lines meet (or are
// parallel); in general the distance of the lines times the sine of their angle, up to sign.
inline double pless_residual(const Eigen::Matrix3d& rig0_from_rig1_rotation,
                             const Eigen::Vector3d& rig0_from_rig1_translation, const PluckerLine& line0,
                             const PluckerLine& line1) {
  const Eigen::Vector3d direction1 = rig0_from_rig1_rotation * line1.direction;
  return line0.moment.dot(direction1) - line0.direction.dot(rig0_from_rig1_translation.cross(direction1)) +
         line0.direction.dot(rig0_from_rig1_rotation * line1.moment);
}

}  // namespace raysfm
