#include "raysfm/camera/projection_inverse.h"

#include <Eigen/Geometry>
#include <Eigen/LU>

namespace raysfm {

bool invert_projection(const Camera& camera, const Ray& ray, Eigen::Matrix<double, 3, 2>* jacobian) {
  Eigen::Vector2d pixel;
  Eigen::Matrix<double, 2, 3> pixel_from_point;
  if (!ray.origin.isZero(0) || !camera.project(ray.direction, &pixel, &pixel_from_point)) return false;
  Eigen::Matrix<double, 3, 2> tangents;
  tangents.col(0) = ray.direction.unitOrthogonal();
  tangents.col(1) = ray.direction.cross(tangents.col(0));
  const Eigen::Matrix2d pixel_from_tangent = pixel_from_point * tangents;
  *jacobian = tangents * pixel_from_tangent.inverse();
  return jacobian->allFinite();
}

}  // namespace raysfm
