#pragma once

#include <Eigen/Core>

#include "raysfm/camera/camera.h"

namespace raysfm {

// d direction / d pixel of a ray of the camera, in its frame, as the inverse of the projection's derivative:
// saves the four iterations that ray_jacobian() needs to undistort. False where the camera does not project
// the ray, or not all its rays meet at its origin.
bool invert_projection(const Camera& camera, const Ray& ray, Eigen::Matrix<double, 3, 2>* jacobian);

}  // namespace raysfm
