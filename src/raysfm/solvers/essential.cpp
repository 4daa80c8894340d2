#include <Eigen/Geometry>
#include <cmath>

#include "raysfm/solvers/five_point.h"

namespace raysfm {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// With E = [t]x R and |t| = 1, the cofactor matrix of E is (t t^T) R, so that R = cof(E) - [t]x E, and -t
// gives the other rotation. t is the null vector of E^T.
std::array<Rigid3, 4> decompose_essential(const Matrix3d& essential) {
  Vector3d t = essential.col(0).cross(essential.col(1));
  for (const Vector3d& other : {Vector3d(essential.col(0).cross(essential.col(2))),
                                Vector3d(essential.col(1).cross(essential.col(2)))}) {
    if (other.squaredNorm() > t.squaredNorm()) t = other;
  }
  t.normalize();
  const Matrix3d e = essential * (std::sqrt(2.0) / essential.norm());
  Matrix3d cofactors;
  for (int i = 0; i < 3; ++i) {
    cofactors.col(i) = e.col((i + 1) % 3).cross(e.col((i + 2) % 3));
  }
  const Matrix3d turn = skew(t) * e;
  const Eigen::Quaterniond a = Eigen::Quaterniond(Matrix3d(cofactors - turn)).normalized();
  const Eigen::Quaterniond b = Eigen::Quaterniond(Matrix3d(cofactors + turn)).normalized();
  return {Rigid3{a, t}, Rigid3{a, -t}, Rigid3{b, t}, Rigid3{b, -t}};
}

int choose_pose(const Matrix3d& essential, std::span<const Vector3d> bearings0,
                std::span<const Vector3d> bearings1, Rigid3* cam1_from_cam0) {
  const std::array<Rigid3, 4> poses = decompose_essential(essential);
  const Vector3d& t = poses[0].translation;
  const std::array<Matrix3d, 2> rotations = {poses[0].rotation.toRotationMatrix(),
                                             poses[2].rotation.toRotationMatrix()};
  std::array<int, 4> in_front = {};
  for (size_t i = 0; i < bearings0.size(); ++i) {
    const Vector3d& b = bearings1[i];
    for (int r = 0; r < 2; ++r) {
      // d1 b = d0 a + t, so that d0 (a x b) = b x t and d1 (a x b) = a x t.
      const Vector3d a = rotations[r] * bearings0[i];
      const Vector3d normal = a.cross(b);
      const double depth0 = b.cross(t).dot(normal), depth1 = a.cross(t).dot(normal);
      in_front[2 * r] += depth0 > 0 && depth1 > 0;
      in_front[2 * r + 1] += depth0 < 0 && depth1 < 0;
    }
  }
  int best = 0;
  for (int i = 1; i < 4; ++i) {
    if (in_front[i] > in_front[best]) best = i;
  }
  *cam1_from_cam0 = poses[best];
  return in_front[best];
}

}  // namespace raysfm
