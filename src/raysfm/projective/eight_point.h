#pragma once

#include <Eigen/Core>
#include <span>

namespace raysfm {

// Normalised eight-point algorithm (Hartley 1995): F of rank 2, unit Frobenius norm, with b^T F a = 0 in the
// least squares sense over 8 or more matches a[i], b[i] (same length). False for fewer, and when the matches
// do not determine F up to rounding.
bool fundamental_from_points(std::span<const Eigen::Vector2d> a, std::span<const Eigen::Vector2d> b,
                             Eigen::Matrix3d* fundamental);

// Homography b ~ H a in the least squares sense over 4 or more matches, unit Frobenius norm. False as above.
bool homography_from_points(std::span<const Eigen::Vector2d> a, std::span<const Eigen::Vector2d> b,
                            Eigen::Matrix3d* homography);

// Squared first-order distance of a match to the epipolar geometry (Sampson).
double sampson_error2(const Eigen::Matrix3d& fundamental, const Eigen::Vector2d& a, const Eigen::Vector2d& b);

// The similarity that brings the centroid to 0 and the mean distance from it to sqrt(2).
Eigen::Matrix3d normalising_similarity(std::span<const Eigen::Vector2d> points);

}  // namespace raysfm
