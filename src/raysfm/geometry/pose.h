#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "raysfm/geometry/rotation.h"

namespace raysfm {

// Of the tangent of a pose (v, w), see retract(), and of its covariance.
using Vector6d = Eigen::Matrix<double, 6, 1>;
using Matrix6d = Eigen::Matrix<double, 6, 6>;

// Rigid motion. A variable of this type is named b_from_a: x_in_b = b_from_a * x_in_a.
struct Rigid3 {
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();  // unit
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();

  Eigen::Vector3d operator*(const Eigen::Vector3d& x) const { return rotation * x + translation; }
  Rigid3 operator*(const Rigid3& b) const {
    return {(rotation * b.rotation).normalized(), rotation * b.translation + translation};
  }
  Rigid3 inverse() const {
    const Eigen::Quaterniond r = rotation.conjugate();
    return {r, -(r * translation)};
  }
};

// Tangent of a pose b_from_a: (translation, rotation), applied on the left, in frame b:
// exp(delta) * pose has rotation exp(w) R and translation exp(w) t + v. See docs/conventions.md.
inline Rigid3 retract(const Rigid3& b_from_a, const Eigen::Matrix<double, 6, 1>& delta) {
  const Eigen::Quaterniond r = exp_so3(delta.tail<3>());
  return {(r * b_from_a.rotation).normalized(), r * b_from_a.translation + delta.head<3>()};
}

// The covariance of a tangent after its frame was turned: c_from_b of tangents in b, to those in c.
inline Matrix6d turned_covariance(const Eigen::Matrix3d& c_from_b, const Matrix6d& covariance) {
  Matrix6d turn = Matrix6d::Zero();
  turn.topLeftCorner<3, 3>() = turn.bottomRightCorner<3, 3>() = c_from_b;
  return turn * covariance * turn.transpose();
}

// Similarity: x_in_b = scale * rotation * x_in_a + translation.
struct Similarity3 {
  double scale = 1.0;
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();

  Eigen::Vector3d operator*(const Eigen::Vector3d& x) const { return scale * (rotation * x) + translation; }
};

}  // namespace raysfm
