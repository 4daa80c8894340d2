#pragma once

#include <Eigen/Core>
#include <array>

#include "raysfm/robust/three_view_refinement.h"

namespace raysfm {

// Unit bearings of five points in three views.
using FiveBearings = std::array<std::array<Eigen::Vector3d, 5>, 3>;

// Motions of a central camera over three views from five matches (LBA09 2.2): five_point() between views 0
// and 2, triangulation, resection of view 1. Only those with every point in front of views 0 and 2; returns
// how many.
int five_point_motions(const FiveBearings& bearings, std::array<ThreeViewMotion, 10>* motions);

// The P3P solution from the first three points that fits all five best; false when there is none.
bool resect(const std::array<Eigen::Vector3d, 5>& bearings, const std::array<Eigen::Vector3d, 5>& points,
            Rigid3* cam_from_world);

}  // namespace raysfm
