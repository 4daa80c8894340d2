#pragma once

#include <Eigen/Core>
#include <array>
#include <span>

#include "raysfm/geometry/pose.h"
#include "raysfm/geometry/ray.h"

namespace raysfm {

// Poses that three points allow.
inline constexpr int kMaxGeneralisedP3pPoses = 8;

// Pose of any ray camera from three points (Nister and Stewenius, JMIV 2007): the depths t_i > 0 along the
// rays satisfy |o_i + t_i d_i - o_j - t_j d_j| = |X_i - X_j| for the three pairs. Two of these equations give
// t_1 and t_2 as roots of quadratics in t_0; eliminating them from the third leaves a polynomial of degree
// eight in t_0. Where the three origins coincide, the problem is p3p()'s and is handed to it.
//
// Writes every rig_from_world with all three points in front of their rays and returns how many, 0 to 8.
// Collinear or coinciding points, parallel rays from one origin and input that is not finite give 0.
int generalised_p3p(std::span<const Ray, 3> rays_in_rig, std::span<const Eigen::Vector3d, 3> points_in_world,
                    std::array<Rigid3, kMaxGeneralisedP3pPoses>* rig_from_world);

}  // namespace raysfm
