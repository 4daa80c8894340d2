#pragma once

#include "raysfm/geometry/pose.h"

namespace raysfm {

inline Similarity3 operator*(const Similarity3& c_from_b, const Similarity3& b_from_a) {
  return {c_from_b.scale * b_from_a.scale, (c_from_b.rotation * b_from_a.rotation).normalized(),
          c_from_b * b_from_a.translation};
}

inline Similarity3 inverse(const Similarity3& b_from_a) {
  const Eigen::Quaterniond r = b_from_a.rotation.conjugate();
  return {1 / b_from_a.scale, r, -(r * b_from_a.translation) / b_from_a.scale};
}

inline Similarity3 similarity_of(const Rigid3& b_from_a) {
  return {1.0, b_from_a.rotation, b_from_a.translation};
}

// The pose of a camera in world b that sees there what it sees in world a: the same rays, lengths in the unit
// of b.
inline Rigid3 carried_over(const Rigid3& cam_from_a, const Similarity3& b_from_a) {
  const Eigen::Quaterniond r = (cam_from_a.rotation * b_from_a.rotation.conjugate()).normalized();
  return {r, b_from_a.scale * cam_from_a.translation - r * b_from_a.translation};
}

}  // namespace raysfm
