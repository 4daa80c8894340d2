#pragma once

#include <Eigen/Core>
#include <span>

#include "raysfm/geometry/pose.h"

namespace raysfm {

// Poses of a camera and points that it sees, most of them on a plane, made those of the other motion by which
// two views of a plane look the same: there the camera turns by another angle, and the plane leans to where
// it goes (Longuet-Higgins 1986; Faugeras and Lustman 1988). The first pose stays, and so do the directions
// in which it sees the points, which all come to be on that plane. Of more than two poses each has the motion
// that belongs to it, which agree on one plane where the camera goes straight; the plane is that of the pose
// farthest away. False, changing nothing, where no pose is away from the first, and where the first would not
// have most points in front of it: they tell that there is no other motion.
bool take_planar_twin(std::span<Rigid3> cam_from_world, std::span<Eigen::Vector3d> points);

}  // namespace raysfm
