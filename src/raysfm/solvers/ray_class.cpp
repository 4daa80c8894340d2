#include "raysfm/solvers/ray_class.h"

#include <Eigen/Eigenvalues>
#include <cmath>

namespace raysfm {

using Eigen::Matrix3d;
using Eigen::Vector3d;

RayClass classify_rays(std::span<const Ray> rays0, std::span<const Ray> rays1, double tolerance,
                       double same) {
  RayClass result;
  const size_t count = rays0.size();
  if (count == 0) return result;
  for (size_t i = 0; i < count; ++i) result.centre += rays0[i].origin + rays1[i].origin;
  result.centre /= 2.0 * static_cast<double>(count);

  Matrix3d scatter = Matrix3d::Zero();
  double farthest2 = 0, largest_jump2 = 0;
  for (size_t i = 0; i < count; ++i) {
    for (const Vector3d& origin : {rays0[i].origin, rays1[i].origin}) {
      const Vector3d d = origin - result.centre;
      scatter += d * d.transpose();
      farthest2 = std::max(farthest2, d.squaredNorm());
    }
    largest_jump2 = std::max(largest_jump2, (rays0[i].origin - rays1[i].origin).squaredNorm());
  }
  result.spread = std::sqrt(scatter.trace() / (2.0 * static_cast<double>(count)));
  const double near = std::max(same, tolerance * std::sqrt(farthest2));
  result.simple = largest_jump2 <= near * near;
  if (!(farthest2 > same * same)) return result;

  const Eigen::SelfAdjointEigenSolver<Matrix3d> eigen(scatter);
  result.axis = eigen.eigenvectors().col(2);
  result.centres = CentreClass::kAxial;
  for (size_t i = 0; i < count; ++i) {
    for (const Vector3d& origin : {rays0[i].origin, rays1[i].origin}) {
      if ((origin - result.centre).cross(result.axis).squaredNorm() > near * near) {
        result.centres = CentreClass::kNonAxial;
      }
    }
  }
  return result;
}

const char* name_of(CentreClass centres) {
  switch (centres) {
    case CentreClass::kCentral:
      return "central";
    case CentreClass::kAxial:
      return "axial";
    case CentreClass::kNonAxial:
      break;
  }
  return "non-axial";
}

}  // namespace raysfm
