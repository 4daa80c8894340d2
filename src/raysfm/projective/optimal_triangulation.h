#pragma once

#include <Eigen/Core>
#include <span>

namespace raysfm {

// A projection, image from world.
using Matrix34d = Eigen::Matrix<double, 3, 4>;

// Moves a match by the least sum of squares so that b^T F a = 0 (Hartley and Sturm 1997). False when an
// epipole lies on its point.
bool correct_match(const Eigen::Matrix3d& fundamental, Eigen::Vector2d* a, Eigen::Vector2d* b);

// The point (4 numbers, unit length) that two or more views P see at the pixels: linear least squares with
// each view's rows of unit weight at the last estimate, twice. False for fewer than two.
bool triangulate_projective(std::span<const Matrix34d> views, std::span<const Eigen::Vector2d> pixels,
                            Eigen::Vector4d* point);

// Canonical pair P_a = [I | 0], P_b = [[e']x F | e'] of a fundamental matrix with b^T F a = 0.
Matrix34d second_view(const Eigen::Matrix3d& fundamental);

}  // namespace raysfm
