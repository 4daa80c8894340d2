#include "raysfm/camera/observed_ray.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>

namespace raysfm {

namespace {

using Matrix32d = Eigen::Matrix<double, 3, 2>;

// Of the origin and the direction of a pixel's ray by the pixel, by central differences over a pixel.
bool ray_derivatives(const Camera& camera, const Eigen::Vector2d& pixel, Matrix32d* origin,
                     Matrix32d* direction) {
  for (int c = 0; c < 2; ++c) {
    const Eigen::Vector2d step = 0.5 * Eigen::Vector2d::Unit(c);
    Ray plus, minus;
    if (!camera.ray(pixel + step, &plus) || !camera.ray(pixel - step, &minus)) return false;
    origin->col(c) = plus.origin - minus.origin;
    direction->col(c) = plus.direction - minus.direction;
  }
  return true;
}

}  // namespace

bool ray_jacobian(const Camera& camera, const Eigen::Vector2d& pixel, Eigen::Matrix<double, 3, 2>* jacobian) {
  Matrix32d origin;
  return ray_derivatives(camera, pixel, &origin, jacobian);
}

bool observe_ray(const Camera& camera, const Eigen::Vector2d& pixel, AngularWeight weight, ObservedRay* ray) {
  Ray in_cam;
  Matrix32d origin_by_pixel, direction_by_pixel;
  if (!camera.ray(pixel, &in_cam) || !ray_derivatives(camera, pixel, &origin_by_pixel, &direction_by_pixel)) {
    return false;
  }
  Eigen::Matrix<double, 2, 3> tangents;
  tangents.row(0) = in_cam.direction.unitOrthogonal();
  tangents.row(1) = in_cam.direction.cross(tangents.row(0).transpose());
  if (weight == AngularWeight::kPixel) {
    const Eigen::Matrix2d tangent_from_pixel = tangents * direction_by_pixel;
    const Eigen::Matrix2d pixel_from_tangent = tangent_from_pixel.inverse();
    if (!pixel_from_tangent.allFinite()) return false;
    tangents = (pixel_from_tangent * tangents).eval();
    // In pixels, what is depth * I for a central camera is depth * I + this: its mean is taken for depth.
    // Rays that converge first have no such origin behind them.
    const double behind = 0.5 * (tangents * origin_by_pixel).trace();
    in_cam.origin -= std::max(0.0, behind) * in_cam.direction;
  }
  const Eigen::Matrix3d rig_from_cam_rotation = camera.rig_from_cam.rotation.toRotationMatrix();
  ray->origin = camera.rig_from_cam * in_cam.origin;
  ray->direction = rig_from_cam_rotation * in_cam.direction;
  ray->tangents = tangents * rig_from_cam_rotation.transpose();
  return true;
}

}  // namespace raysfm
