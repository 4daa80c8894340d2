#pragma once

#include <algorithm>
#include <cmath>
#include <variant>

#include "raysfm/residuals/residual_kernels.h"

namespace raysfm {

// The error of eight lanes of one group. This is all that the adjustment knows about cameras: another error
// needs another class.
class BlockResidual {
 public:
  virtual ~BlockResidual() = default;
  // From block->x to the rest. `lane` is the first of the eight. Without `with_jacobian` the derivative may
  // be left unspecified.
  virtual void evaluate(int lane, bool with_jacobian, ResidualBlock* block) const = 0;
};

// Predicted minus observed pixel of any camera that can project; `u` and `v` by lane.
template <typename Model>
class PixelResidual : public BlockResidual {
 public:
  PixelResidual(const Camera& camera, const Model& model, const double* u, const double* v)
      : model_(model), u_(u), v_(v) {
    const Rigid3 cam_from_rig = camera.rig_from_cam.inverse();
    rotation_ = cam_from_rig.rotation.toRotationMatrix();
    translation_ = cam_from_rig.translation;
  }

  void evaluate(int lane, bool with_jacobian, ResidualBlock* block) const override {
    for (int k = 0; k < kBlockLanes; ++k) {
      block->squared[k] = HUGE_VAL;
      if constexpr (ProjectiveModel<Model>) {
        const Eigen::Vector3d x_in_rig(block->x[0][k], block->x[1][k], block->x[2][k]);
        Eigen::Vector2d pixel;
        Eigen::Matrix<double, 2, 3> jacobian;
        if (!model_.project(rotation_ * x_in_rig + translation_, &pixel,
                            with_jacobian ? &jacobian : nullptr)) {
          continue;
        }
        const Eigen::Vector2d r = pixel - Eigen::Vector2d(u_[lane + k], v_[lane + k]);
        block->residual[0][k] = r[0], block->residual[1][k] = r[1];
        block->squared[k] = r.squaredNorm();
        if (!with_jacobian) continue;
        jacobian = (jacobian * rotation_).eval();
        for (int c = 0; c < 6; ++c) block->jacobian[c][k] = jacobian(c / 3, c % 3);
      }
    }
  }

 private:
  const Model& model_;
  const double *u_, *v_;
  Eigen::Matrix3d rotation_;
  Eigen::Vector3d translation_;
};

// The same, eight lanes at once.

template <typename Model>
PinholeInRig pinhole_in_rig(const Camera& camera, const Model& model) {
  PinholeInRig pinhole{model.fx, model.fy, model.cx, model.cy, {}, {}};
  const Rigid3 cam_from_rig = camera.rig_from_cam.inverse();
  const Eigen::Matrix3d by_columns = cam_from_rig.rotation.conjugate().toRotationMatrix();
  std::copy_n(by_columns.data(), 9, pinhole.rotation);
  std::copy_n(cam_from_rig.translation.data(), 3, pinhole.translation);
  return pinhole;
}

// Models with residuals of their own for eight lanes.
template <>
class PixelResidual<Pinhole> : public BlockResidual {
 public:
  PixelResidual(const Camera& camera, const Pinhole& model, const double* u, const double* v)
      : u_(u), v_(v), camera_(pinhole_in_rig(camera, model)) {}
  void evaluate(int lane, bool, ResidualBlock* block) const override {
    pinhole_residuals(camera_, u_ + lane, v_ + lane, block);
  }

 private:
  const double *u_, *v_;
  PinholeInRig camera_;
};

// The same with distortion.
template <>
class PixelResidual<Radtan> : public BlockResidual {
 public:
  PixelResidual(const Camera& camera, const Radtan& m, const double* u, const double* v)
      : u_(u), v_(v), camera_{pinhole_in_rig(camera, m), m.k1, m.k2, m.k3, m.p1, m.p2, m.max_radius2} {}
  void evaluate(int lane, bool, ResidualBlock* block) const override {
    radtan_residuals(camera_, u_ + lane, v_ + lane, block);
  }

 private:
  const double *u_, *v_;
  RadtanInRig camera_;
};

// f(const BlockResidual&) with the error of a camera.
template <typename F>
auto with_pixel_residual(const Camera& camera, const double* u, const double* v, F f) {
  return std::visit([&](const auto& model) { return f(PixelResidual(camera, model, u, v)); }, camera.model);
}

// The angular error; `rays` by block of lanes.
class AngularResidual : public BlockResidual {
 public:
  explicit AngularResidual(const RayBlock* rays) : rays_(rays) {}
  void evaluate(int lane, bool, ResidualBlock* block) const override {
    angular_residuals(rays_[lane / kBlockLanes], block);
  }

 private:
  const RayBlock* rays_;
};

// The error of a lens; the block must be one with a lens.
class LensResidual : public BlockResidual {
 public:
  LensResidual(const BalLens& lens, const double* u, const double* v) : lens_(lens), u_(u), v_(v) {}
  void evaluate(int lane, bool, ResidualBlock* block) const override {
    lens_residuals(lens_, u_ + lane, v_ + lane, static_cast<ObservationBlock<9>*>(block));
  }

 private:
  BalLens lens_;
  const double *u_, *v_;
};

}  // namespace raysfm
