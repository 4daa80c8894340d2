#pragma once

#include <Eigen/Core>
#include <span>

#include "raysfm/geometry/ray.h"

namespace raysfm {

// A point seen along several rays. Rays and point share one frame; the frame does not matter.
struct Triangulation {
  Eigen::Vector3d point = Eigen::Vector3d::Zero();
  double parallax = 0;   // radians in [0, pi]: the largest angle between two of the rays' directions
  double rms_angle = 0;  // radians: root mean square angle between each ray and its view of the point
  double max_angle = 0;  // radians: the largest of these angles
};

// Angle between two unit vectors, accurate also near 0 and pi; radians in [0, pi].
double angle_between(const Eigen::Vector3d& unit_a, const Eigen::Vector3d& unit_b);

// The largest angle between the directions of two of the rays, radians in [0, pi]; 0 of fewer than two.
double largest_parallax(std::span<const Ray> rays);

// The point halfway between two rays at their closest approach. False for parallel rays and when the closest
// approach lies behind an origin. Two square roots and no iteration: for the inner loops of RANSAC.
bool triangulate_midpoint(const Ray& a, const Ray& b, Eigen::Vector3d* point);

// Point of least sum of squared angular errors over two or more rays (LBA09 2.4 and 3.2): the linear solution
// (closest point to all lines) refined by Gauss-Newton on the tangents of the angles. False, leaving the
// output unspecified, when the rays are (nearly) parallel, fewer than two, or the point is behind an origin.
bool triangulate(std::span<const Ray> rays, Triangulation* result);

}  // namespace raysfm
