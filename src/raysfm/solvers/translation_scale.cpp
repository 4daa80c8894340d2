#include "raysfm/solvers/translation_scale.h"

#include <Eigen/Geometry>

namespace raysfm {

using Eigen::Vector3d;

TranslationScale translation_scale(const Eigen::Matrix3d& rotation, const Vector3d& start,
                                   const Vector3d& unit_direction, const Ray& ray0, const Ray& ray1) {
  const Vector3d normal = ray1.direction.cross(rotation * ray0.direction);
  return {normal.dot(rotation * ray0.origin + start - ray1.origin), normal.dot(unit_direction)};
}

}  // namespace raysfm
