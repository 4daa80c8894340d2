#pragma once

#include <Eigen/Core>
#include <array>
#include <span>

#include "raysfm/geometry/pose.h"

namespace raysfm {

// Pose of a central camera from three points, the problem of Grunert (1841) that LBA09 2.3 solves: the depths
// d_i > 0 along the unit bearings satisfy |d_i b_i - d_j b_j| = |X_i - X_j| for the three pairs. Grunert
// eliminates them to a quartic; here, as in Persson and Nordberg (ECCV 2018) and Ding et al. (CVPR 2023), a
// degenerate member of the pencil of the two homogeneous conics is split into lines, which costs a cubic and
// two quadratics and is better conditioned. The solutions are the same.
//
// Writes every cam_from_world with all three points in front (positive depth along their bearings) and
// returns how many, 0 to 4. Collinear or coinciding points and coinciding bearings give 0.
int p3p(std::span<const Eigen::Vector3d, 3> bearings, std::span<const Eigen::Vector3d, 3> points_in_world,
        std::array<Rigid3, 4>* cam_from_world);

}  // namespace raysfm
