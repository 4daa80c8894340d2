#pragma once

#include <Eigen/Core>

#include "raysfm/camera/camera.h"

namespace raysfm {

// Predicted minus observed pixel of a point in the rig's frame, and its derivative by that point. This is all
// that the adjustment knows about cameras: another error needs another class with the same call. `u` and `v`
// are the observed pixels by lane.
template <typename Model>
class PixelResidual {
 public:
  PixelResidual(const Camera& camera, const Model& model, const double* u, const double* v)
      : model_(model), u_(u), v_(v) {
    const Rigid3 cam_from_rig = camera.rig_from_cam.inverse();
    rotation_ = cam_from_rig.rotation.toRotationMatrix();
    translation_ = cam_from_rig.translation;
    is_rig_ = rotation_ == Eigen::Matrix3d::Identity() && translation_ == Eigen::Vector3d::Zero();
  }

  // False, leaving the outputs unspecified, where the point does not project.
  bool operator()(const Eigen::Vector3d& x_in_rig, int lane, Eigen::Vector2d* residual,
                  Eigen::Matrix<double, 2, 3>* jacobian) const {
    if constexpr (ProjectiveModel<Model>) {
      const Eigen::Vector3d x_in_cam = is_rig_ ? x_in_rig : rotation_ * x_in_rig + translation_;
      Eigen::Vector2d pixel;
      if (!model_.project(x_in_cam, &pixel, jacobian)) return false;
      *residual = pixel - Eigen::Vector2d(u_[lane], v_[lane]);
      if (jacobian && !is_rig_) *jacobian = (*jacobian * rotation_).eval();
      return true;
    } else {
      return false;
    }
  }

 private:
  const Model& model_;
  const double* u_;
  const double* v_;
  Eigen::Matrix3d rotation_;
  Eigen::Vector3d translation_;
  bool is_rig_;  // camera and rig share their frame
};

}  // namespace raysfm
