#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace raysfm {

// Half line of sight (s, d) of LBA09 section 3: all points origin + t * direction, t > 0.
struct Ray {
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();      // s, zero for a central camera
  Eigen::Vector3d direction = Eigen::Vector3d::UnitZ();  // d, unit length
};

// Two unit vectors orthogonal to the vector `unit` and to each other, one a row.
inline Eigen::Matrix<double, 2, 3> tangent_rows(const Eigen::Vector3d& unit) {
  Eigen::Matrix<double, 2, 3> rows;
  rows.row(0) = unit.unitOrthogonal();
  rows.row(1) = unit.cross(Eigen::Vector3d(rows.row(0)));
  return rows;
}

}  // namespace raysfm
