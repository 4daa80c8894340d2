#pragma once

#include <vector>

#include "raysfm/geometry/pose.h"

namespace raysfm {

// Poses of a camera (of the rig, where there are several) over time. Both vectors have the same length.
struct Trajectory {
  std::vector<double> timestamps;  // seconds, strictly increasing
  std::vector<Rigid3> world_from_cam;

  int size() const { return static_cast<int>(timestamps.size()); }
};

}  // namespace raysfm
