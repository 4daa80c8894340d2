#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "raysfm/camera/camera.h"
#include "raysfm/camera/observed_ray.h"
#include "raysfm/geometry/pose.h"
#include "raysfm/optim/robust_loss.h"

namespace raysfm {

using Matrix6d = Eigen::Matrix<double, 6, 6>;
using Vector6d = Eigen::Matrix<double, 6, 1>;

// Known points and where a rig saw them: flat arrays of one length. Seen at pixels of cameras that project,
// or along rays, for any camera: where `rays` is not empty, neither the pixels nor the cameras (nor the rig)
// are looked at. The rays are in the rig's frame and whitened to pixels (AngularWeight::kPixel), so that
// every figure in pixels keeps its meaning; unwhitened, all of them are tangents of angles. Where `sigmas` is
// not empty, every residual is divided by its standard deviation, and those figures count such.
struct PoseObservations {
  std::span<const Eigen::Vector3d> points_in_world;
  std::span<const Eigen::Vector2d> pixels = {};
  std::span<const int> cameras = {};  // index into Rig::cameras; empty: all in camera 0
  std::span<const ObservedRay> rays = {};
  std::span<const float> sigmas = {};  // pixels, > 0; empty: all 1

  int size() const { return static_cast<int>(points_in_world.size()); }
  int camera(int i) const { return cameras.empty() ? 0 : cameras[i]; }
  double sigma(int i) const { return sigmas.empty() ? 1.0 : sigmas[i]; }
};

// The residuals of one pose, of pixels (predicted minus observed) or of rays (ObservedRay), and their
// derivatives by the tangent of rig_from_world (see retract()). Borrows its inputs.
class PoseResiduals {
 public:
  PoseResiduals(const Rig& rig, const PoseObservations& observations);

  using Jacobian = Eigen::Matrix<double, 2, 6, Eigen::RowMajor>;

  // Residual of observation i; false where the point does not project or is behind its ray. `jacobian` may be
  // null.
  bool evaluate(const Rigid3& rig_from_world, int i, Eigen::Vector2d* residual, Jacobian* jacobian) const {
    return evaluate(rig_from_world.rotation.toRotationMatrix(), rig_from_world.translation, i, residual,
                    jacobian);
  }
  bool evaluate(const Eigen::Matrix3d& rig_from_world_rotation,
                const Eigen::Vector3d& rig_from_world_translation, int i, Eigen::Vector2d* residual,
                Jacobian* jacobian) const;

  struct NormalEquations {
    double cost = 0;  // half the sum of the losses
    Matrix6d hessian = Matrix6d::Zero();
    Vector6d gradient = Vector6d::Zero();
    int failed = 0;  // observations without a residual
  };
  // Over the observations `active`. With kNone the hessian is J^T J.
  NormalEquations normal_equations(const Rigid3& rig_from_world, std::span<const int> active,
                                   const RobustLoss& loss) const;

  int size() const { return observations_.size(); }

 private:
  bool pixel_residual(const Eigen::Vector3d& in_rig, int i, Eigen::Vector2d* residual,
                      Eigen::Matrix<double, 2, 3>* by_point) const;

  const Rig& rig_;
  const PoseObservations& observations_;
  std::vector<Eigen::Matrix3d> cam_from_rig_rotation_;
  std::vector<Eigen::Vector3d> cam_from_rig_translation_;
};

// Levenberg-Marquardt over the six parameters from *rig_from_world. Returns the iterations; the cost never
// rises.
int minimise_pose(const PoseResiduals& residuals, std::span<const int> active, const RobustLoss& loss,
                  int max_iterations, Rigid3* rig_from_world);

}  // namespace raysfm
