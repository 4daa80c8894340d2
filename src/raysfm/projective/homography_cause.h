#pragma once

#include <Eigen/Core>
#include <span>

namespace raysfm {

// Why homographies relate images.
enum class HomographyCause {
  kRotation,  // the camera turns, or turns and zooms
  kPlane,     // the points lie in a plane
  kStill,     // the camera hardly moves
  kUnclear,
};

// Of homographies b ~ H a between pairs of images; (0, 0) near the principal point, square pixels, units
// within a factor of ten of the focal length. A camera that turns has H = K_b R K_a^-1; for a plane seen from
// two places no focal lengths make K_b^-1 H K_a a rotation.
HomographyCause homography_cause(std::span<const Eigen::Matrix3d> homographies);

}  // namespace raysfm
