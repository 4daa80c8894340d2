#include "raysfm/solvers/translation_scale.h"

#include <Eigen/Geometry>
#include <cmath>

namespace raysfm {

using Eigen::Vector3d;

bool translation_scale(const Eigen::Matrix3d& rotation, const Vector3d& start, const Vector3d& unit_direction,
                       const Ray& ray0, const Ray& ray1, double* scale) {
  constexpr double kMinSine = 1e-9;
  const Vector3d normal = ray1.direction.cross(rotation * ray0.direction);
  const double slope = normal.dot(unit_direction);
  if (!(std::abs(slope) > kMinSine)) return false;
  *scale = -normal.dot(rotation * ray0.origin + start - ray1.origin) / slope;
  return std::isfinite(*scale);
}

}  // namespace raysfm
