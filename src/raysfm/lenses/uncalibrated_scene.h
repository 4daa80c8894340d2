#pragma once

#include <Eigen/Core>
#include <vector>

#include "raysfm/geometry/pose.h"
#include "raysfm/lenses/lens.h"

namespace raysfm {

// Poses, lenses and points of the images and points of PointTracks; scale and world frame are free.
struct UncalibratedScene {
  std::vector<Rigid3> cam_from_world;   // one per image
  std::vector<Lens> lenses;             // one per image
  std::vector<Eigen::Vector3d> points;  // world frame
};

}  // namespace raysfm
