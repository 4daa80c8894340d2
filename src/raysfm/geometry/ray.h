#pragma once

#include <Eigen/Core>

namespace raysfm {

// Half line of sight (s, d) of LBA09 section 3: all points origin + t * direction, t > 0.
struct Ray {
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();      // s, zero for a central camera
  Eigen::Vector3d direction = Eigen::Vector3d::UnitZ();  // d, unit length
};

}  // namespace raysfm
