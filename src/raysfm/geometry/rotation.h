#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace raysfm {

// [v]x, with [v]x w = v x w.
inline Eigen::Matrix3d skew(const Eigen::Vector3d& v) {
  Eigen::Matrix3d m;
  m << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
  return m;
}

// Exponential of so(3): the rotation about `omega` by |omega| radians.
inline Eigen::Quaterniond exp_so3(const Eigen::Vector3d& omega) {
  const double angle2 = omega.squaredNorm();
  double w, s;  // s = sin(angle / 2) / angle
  if (angle2 < 1e-8) {
    w = 1.0 - angle2 / 8.0;
    s = 0.5 - angle2 / 48.0;
  } else {
    const double angle = std::sqrt(angle2);
    w = std::cos(0.5 * angle);
    s = std::sin(0.5 * angle) / angle;
  }
  return Eigen::Quaterniond(w, s * omega.x(), s * omega.y(), s * omega.z()).normalized();
}

// Logarithm of SO(3): the rotation vector of `q` with angle in [0, pi].
inline Eigen::Vector3d log_so3(const Eigen::Quaterniond& q) {
  const Eigen::Vector3d v = q.w() < 0 ? Eigen::Vector3d(-q.vec()) : Eigen::Vector3d(q.vec());
  const double w = std::abs(q.w());
  const double n = v.norm();
  if (n < 1e-9) return 2.0 * v;
  return 2.0 * std::atan2(n, w) / n * v;
}

// Angle of the rotation, radians in [0, pi].
inline double rotation_angle(const Eigen::Quaterniond& q) {
  return 2.0 * std::atan2(q.vec().norm(), std::abs(q.w()));
}

// The shortest rotation that takes the unit vector `d` to the z axis (LBA09 3.2, the matrix R_j^i).
Eigen::Matrix3d rotation_to_z(const Eigen::Vector3d& d);

}  // namespace raysfm
