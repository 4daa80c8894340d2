#include "raysfm/camera/observed_ray.h"

#include <Eigen/Geometry>
#include <Eigen/LU>

namespace raysfm {

bool ray_jacobian(const Camera& camera, const Eigen::Vector2d& pixel, Eigen::Matrix<double, 3, 2>* jacobian) {
  for (int c = 0; c < 2; ++c) {
    const Eigen::Vector2d step = 0.5 * Eigen::Vector2d::Unit(c);
    Ray plus, minus;
    if (!camera.ray(pixel + step, &plus) || !camera.ray(pixel - step, &minus)) return false;
    jacobian->col(c) = plus.direction - minus.direction;
  }
  return true;
}

bool observe_ray(const Camera& camera, const Eigen::Vector2d& pixel, AngularWeight weight, ObservedRay* ray) {
  Ray in_cam;
  Eigen::Matrix<double, 3, 2> by_pixel;
  if (!camera.ray(pixel, &in_cam) || !ray_jacobian(camera, pixel, &by_pixel)) return false;
  Eigen::Matrix<double, 2, 3> tangents;
  tangents.row(0) = in_cam.direction.unitOrthogonal();
  tangents.row(1) = in_cam.direction.cross(tangents.row(0).transpose());
  if (weight == AngularWeight::kPixel) {
    const Eigen::Matrix2d tangent_from_pixel = tangents * by_pixel;
    const Eigen::Matrix2d pixel_from_tangent = tangent_from_pixel.inverse();
    if (!pixel_from_tangent.allFinite()) return false;
    tangents = (pixel_from_tangent * tangents).eval();
  }
  const Eigen::Matrix3d rig_from_cam_rotation = camera.rig_from_cam.rotation.toRotationMatrix();
  ray->origin = camera.rig_from_cam * in_cam.origin;
  ray->direction = rig_from_cam_rotation * in_cam.direction;
  ray->tangents = tangents * rig_from_cam_rotation.transpose();
  return true;
}

}  // namespace raysfm
