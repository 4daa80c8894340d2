#include "raysfm/uncertainty/calibration_changes.h"

#include "raysfm/camera/ray_change.h"

namespace raysfm {

CalibrationChanges::CalibrationChanges(const TrackingRig& rig, std::span<const Rig> others) : rig_(rig) {
  for (const Rig& other : others) {
    others_.push_back(other.cameras);
    cam_from_rig_.emplace_back();
    for (const Camera& camera : other.cameras) cam_from_rig_.back().push_back(camera.rig_from_cam.inverse());
  }
}

bool CalibrationChanges::at(int c, const Eigen::Vector2d& pixel, const ObservedRay* ray,
                            const Eigen::Vector3d& x, Eigen::Ref<Eigen::Matrix2Xd> changes) const {
  if (!rig_.angular()) return differences_of_pixels(c, x, changes);
  const double depth = ray->direction.dot(x - ray->origin);
  Ray present, other;
  if (!ray_in_rig(rig_.camera(c), pixel, &present)) return false;
  for (int k = 0; k < size(); ++k) {
    if (!ray_in_rig(others_[k][c], pixel, &other)) return false;
    changes.col(k) = residual_change(*ray, depth, present, other);
  }
  return true;
}

bool CalibrationChanges::differences_of_pixels(int c, const Eigen::Vector3d& x,
                                               Eigen::Ref<Eigen::Matrix2Xd> changes) const {
  Eigen::Vector2d present, other;
  if (!rig_.camera(c).project(rig_.cam_from_rig(c) * x, &present)) return false;
  for (int k = 0; k < size(); ++k) {
    if (!others_[k][c].project(cam_from_rig_[k][c] * x, &other)) return false;
    changes.col(k) = other - present;
  }
  return true;
}

}  // namespace raysfm
