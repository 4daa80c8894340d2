#pragma once

#include <Eigen/Core>

#include "raysfm/camera/camera.h"

namespace raysfm {

// The ray of an observed pixel in the rig's frame, with the plane in which the angular error is measured.
// With D = X - origin for a point X in the rig's frame,
//
//   r = tangents D / (direction . D)
//
// is the residual of LBA09 3.2: its length is the tangent of the angle between ray and point when the rows of
// `tangents` are unit vectors orthogonal to the direction (and to each other). Whitened, they are scaled and
// sheared so that r is what the angle amounts to in pixels of the camera, and the origin is where the rays of
// neighbouring pixels come from: on the line of the ray, but behind a convex mirror's surface (between its
// two caustics, where these differ). From elsewhere the angle of a pixel would depend on the distance of the
// point, and an adjustment would move points away to make errors smaller. A point with direction . D <= 0
// lies behind the ray and has no residual.
struct ObservedRay {
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();
  Eigen::Vector3d direction = Eigen::Vector3d::UnitZ();  // unit length
  Eigen::Matrix<double, 2, 3> tangents = Eigen::Matrix<double, 2, 3>::Zero();

  // Residual of a point in the rig's frame and its derivative by that point (null: not wanted). False,
  // leaving the outputs unspecified, where the point is behind the ray or the residual is not finite.
  bool residual(const Eigen::Vector3d& point_in_rig, Eigen::Vector2d* r,
                Eigen::Matrix<double, 2, 3>* jacobian = nullptr) const {
    const Eigen::Vector3d d = point_in_rig - origin;
    const double depth = direction.dot(d);
    if (!(depth > 0)) return false;
    *r = tangents * d / depth;
    if (jacobian) *jacobian = (tangents - *r * direction.transpose()) / depth;
    return r->allFinite();
  }
};

enum class AngularWeight {
  kNone,   // residuals are tangents of angles, as in the paper
  kPixel,  // residuals are in pixels of the observing camera
};

// False where the pixel, or one of its neighbours at half a pixel, sees nothing.
bool observe_ray(const Camera& camera, const Eigen::Vector2d& pixel, AngularWeight weight, ObservedRay* ray);

// d direction / d pixel in the camera's frame, by central differences over a pixel. False as above.
bool ray_jacobian(const Camera& camera, const Eigen::Vector2d& pixel, Eigen::Matrix<double, 3, 2>* jacobian);

}  // namespace raysfm
