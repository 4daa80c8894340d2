#pragma once

#include <Eigen/Core>
#include <array>
#include <span>

#include "raysfm/geometry/pose.h"

namespace raysfm {

// Relative pose of two central cameras from five matches (Nister, PAMI 2004).
//
// `bearings0` and `bearings1` are unit vectors of the same five points in cameras 0 and 1. Writes every real
// essential matrix E = [t]x R (cam1_from_cam0 = (R, t)) with bearing1^T E bearing0 = 0, scaled to Frobenius
// norm sqrt(2), so that |t| = 1, and returns how many there are, 0 to 10. Degenerate samples (repeated
// bearings, no translation) may give none; the output is always finite.
int five_point(std::span<const Eigen::Vector3d, 5> bearings0, std::span<const Eigen::Vector3d, 5> bearings1,
               std::array<Eigen::Matrix3d, 10>* essentials);

// The four poses cam1_from_cam0 with |translation| = 1 whose essential matrix is +-`essential`: (Ra, t),
// (Ra, -t), (Rb, t), (Rb, -t).
std::array<Rigid3, 4> decompose_essential(const Eigen::Matrix3d& essential);

// The one of the four poses that puts most of the matched points in front of both cameras (both depths
// positive); returns how many. Any number of bearings; with none, 0 and the first pose.
int choose_pose(const Eigen::Matrix3d& essential, std::span<const Eigen::Vector3d> bearings0,
                std::span<const Eigen::Vector3d> bearings1, Rigid3* cam1_from_cam0);

}  // namespace raysfm
