#pragma once

#include <Eigen/Core>
#include <span>

#include "raysfm/geometry/pose.h"

namespace raysfm {

// Poses of a camera and the points it sees, made those that look nearly the same through a narrow lens, and
// would look quite the same from afar: what was near is far, and the camera goes round it the other way
// (Necker reversal; Hartley and Zisserman, 14.3.3 and 14.4). The first pose stays, and so do the directions
// in which it sees the points; all need at least one point, and none may lie in the first camera's centre.
void reverse_relief(std::span<Rigid3> cam_from_world, std::span<Eigen::Vector3d> points);

}  // namespace raysfm
