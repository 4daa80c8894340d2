#pragma once

#include <Eigen/Core>
#include <string_view>

#include "raysfm/geometry/pose.h"

namespace raysfm {

// What may be taken off before trajectories are compared.
enum class Alignment { kSim3, kSe3, kNone };

std::string_view alignment_name(Alignment alignment);  // "sim3", "se3" or "none"

// The transform that takes the points of the estimate nearest to those of the truth, in the sense of least
// squares (Umeyama 1991), column by column. Both are 3 x n, n > 0. Where all points of the estimate coincide
// nothing but a translation can be known: rotation is the identity and scale is 1. The scale is 1 for kSe3,
// and kNone returns the identity.
Similarity3 align_points(const Eigen::Matrix3Xd& estimate, const Eigen::Matrix3Xd& truth,
                         Alignment alignment);

// Pose of the same camera when its world is replaced: `b_from_a` also scales the camera's position.
Rigid3 transform_pose(const Similarity3& b_from_a, const Rigid3& a_from_cam);

}  // namespace raysfm
