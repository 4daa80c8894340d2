#pragma once

#include <Eigen/Core>
#include <span>

#include "raysfm/projective/optimal_triangulation.h"

namespace raysfm {

// View P (3x4, unit norm) with pixel ~ P X in the least squares sense over 6 or more points X (4 numbers).
// The pixels are best near unit size. False for fewer, and when the points do not determine it up to
// rounding.
bool view_from_points(std::span<const Eigen::Vector4d> points, std::span<const Eigen::Vector2d> pixels,
                      Matrix34d* view);

}  // namespace raysfm
