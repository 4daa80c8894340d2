#pragma once

#include <span>
#include <vector>

#include "raysfm/bundle/observation_layout.h"
#include "raysfm/camera/observed_ray.h"

namespace raysfm {

// The angular error of a point in the rig's frame (LBA09 3.2), called as PixelResidual is.
struct AngularResidual {
  std::span<const ObservedRay> rays;  // by observation
  std::span<const ObservationLayout::Lane> lanes;

  bool operator()(const Eigen::Vector3d& x_in_rig, int lane, Eigen::Vector2d* residual,
                  Eigen::Matrix<double, 2, 3>* jacobian) const {
    return rays[lanes[lane].observation].residual(x_in_rig, residual, jacobian);
  }
};

}  // namespace raysfm
