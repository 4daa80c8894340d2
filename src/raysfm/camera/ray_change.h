#pragma once

#include <Eigen/Core>

#include "raysfm/camera/camera.h"
#include "raysfm/camera/observed_ray.h"

namespace raysfm {

// Ray of a pixel in the rig's frame. False where the pixel sees nothing.
inline bool ray_in_rig(const Camera& camera, const Eigen::Vector2d& pixel, Ray* ray) {
  if (!camera.ray(pixel, ray)) return false;
  ray->origin = camera.rig_from_cam * ray->origin;
  ray->direction = camera.rig_from_cam.rotation * ray->direction;
  return true;
}

// By how much the angular residual of a point at `depth` along an observed ray changes where that ray is
// `moved` and not `present`, both in the rig's frame and near each other. The axes of the error stay, and are
// orthogonal to the moved ray but for what is small of the second order.
inline Eigen::Vector2d residual_change(const ObservedRay& observed, double depth, const Ray& present,
                                       const Ray& moved) {
  const Eigen::Vector3d motion =
      moved.direction - present.direction + (moved.origin - present.origin) / depth;
  return -observed.tangents * motion;
}

}  // namespace raysfm
