#pragma once

#include <Eigen/Geometry>
#include <numbers>

#include "raysfm/geometry/pose.h"

namespace raysfm::testing_support {

constexpr double kDegree = std::numbers::pi / 180;

// Angle of the rotation between two poses, radians.
inline double rotation_error(const Rigid3& a, const Rigid3& b) {
  return rotation_angle(a.rotation * b.rotation.conjugate());
}

// What is left of the truth's translation and rotation vector once the estimate is taken off.
inline Eigen::Matrix<double, 6, 1> pose_error(const Rigid3& truth, const Rigid3& estimate) {
  Eigen::Matrix<double, 6, 1> delta;
  const Eigen::AngleAxisd turn(truth.rotation * estimate.rotation.conjugate());
  delta << truth.translation - turn * estimate.translation, turn.angle() * turn.axis();
  return delta;
}

}  // namespace raysfm::testing_support
