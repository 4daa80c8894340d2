#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "raysfm/camera/observed_ray.h"
#include "raysfm/views/tracking_rig.h"

namespace raysfm {

// How residuals change where a rig has one of some other calibrations, which are near its own. Keeps the rig.
class CalibrationChanges {
 public:
  // Each of the other calibrations is of the same cameras.
  CalibrationChanges(const TrackingRig& rig, std::span<const Rig> others);

  int size() const { return static_cast<int>(others_.size()); }

  // Of camera c, which sees a point at `x` in the rig's frame, at `pixel` and where residuals are angular
  // by `ray`: a column for each of the other calibrations, in the unit of the residual. False where one of
  // them does not see it.
  bool at(int c, const Eigen::Vector2d& pixel, const ObservedRay* ray, const Eigen::Vector3d& x,
          Eigen::Ref<Eigen::Matrix2Xd> changes) const;

 private:
  bool differences_of_pixels(int c, const Eigen::Vector3d& x, Eigen::Ref<Eigen::Matrix2Xd> changes) const;

  const TrackingRig& rig_;
  std::vector<std::vector<Camera>> others_;
  std::vector<std::vector<Rigid3>> cam_from_rig_;
};

}  // namespace raysfm
