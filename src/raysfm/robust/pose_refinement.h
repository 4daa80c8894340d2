#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "raysfm/camera/camera.h"
#include "raysfm/camera/observed_ray.h"
#include "raysfm/core/paged_memory.h"
#include "raysfm/geometry/pose.h"
#include "raysfm/optim/robust_loss.h"
#include "raysfm/residuals/residual_kernels.h"

namespace raysfm {

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
// derivatives by the tangent of rig_from_world (see retract()). Borrows the rig; memory only grows.
class PoseResiduals {
 public:
  // Takes over all observations, or those listed.
  void load(const Rig& rig, const PoseObservations& observations);
  void load(const Rig& rig, const PoseObservations& observations, std::span<const int> indices);
  int size() const { return static_cast<int>(lane_of_.size()); }

  using Jacobian = Eigen::Matrix<double, 2, 6, Eigen::RowMajor>;

  // Residual and derivative of the i-th observation loaded; false where the point does not project or is
  // behind its ray.
  bool evaluate(const Rigid3& rig_from_world, int i, Eigen::Vector2d* residual, Jacobian* jacobian) const;

  // |residual|^2 of every observation loaded; not finite where there is none.
  void square(const Rigid3& rig_from_world, std::vector<double>* squared) const;

  struct NormalEquations {
    double cost = 0;  // half the sum of the losses
    Matrix6d hessian = Matrix6d::Zero();
    Vector6d gradient = Vector6d::Zero();
    int failed = 0;  // observations without a residual
  };
  // With kNone the hessian is J^T J.
  NormalEquations normal_equations(const Rigid3& rig_from_world, const RobustLoss& loss) const;

 private:
  struct Block {
    double point_in_world[3][kBlockLanes];
    double inverse_variance[kBlockLanes];  // zero in the padding
  };
  struct Group {
    int camera;
    int begin, end;  // blocks
  };
  void set_lane(const PoseObservations& observations, int i, int lane);
  template <typename F>
  void for_each_block(const Rigid3& rig_from_world, F f) const;

  const Rig* rig_ = nullptr;
  bool has_rays_ = false;
  std::vector<Group> groups_;  // one for each camera; rays are one
  LargeArray<Block> blocks_;
  LargeArray<RayBlock> rays_;            // by block
  std::vector<double> u_, v_;            // observed pixels by lane
  std::vector<int> lane_of_;             // by observation loaded
  std::vector<int> all_;                 // 0, 1, 2 ...
  mutable std::vector<double> by_lane_;  // scratch
};

// Levenberg-Marquardt over the six parameters from *rig_from_world. Returns the iterations; the cost never
// rises.
int minimise_pose(const PoseResiduals& residuals, const RobustLoss& loss, int max_iterations,
                  Rigid3* rig_from_world);

}  // namespace raysfm
