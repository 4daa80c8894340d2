#include "raysfm/geometry/rotation.h"

namespace raysfm {

Eigen::Matrix3d rotation_to_z(const Eigen::Vector3d& d) {
  // The closed form divides by 1 + d.z; turn the far hemisphere around first.
  if (d.z() < 0) {
    const Eigen::Vector3d flipped(d.x(), -d.y(), -d.z());
    return rotation_to_z(flipped) * Eigen::Vector3d(1, -1, -1).asDiagonal();
  }
  const double a = 1.0 / (1.0 + d.z());
  Eigen::Matrix3d m;
  m << 1 - a * d.x() * d.x(), -a * d.x() * d.y(), -d.x(),  //
      -a * d.x() * d.y(), 1 - a * d.y() * d.y(), -d.y(),   //
      d.x(), d.y(), d.z();
  return m;
}

}  // namespace raysfm
