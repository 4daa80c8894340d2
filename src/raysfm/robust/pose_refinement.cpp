#include "raysfm/robust/pose_refinement.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <numeric>

#include "raysfm/optim/levenberg_marquardt.h"
#include "raysfm/residuals/block_residual.h"
#include "raysfm/residuals/normal_kernel.h"

namespace raysfm {

using Eigen::Matrix3d;
using Eigen::Vector2d;
using Eigen::Vector3d;

void PoseResiduals::load(const Rig& rig, const PoseObservations& observations) {
  all_.resize(observations.size());
  std::iota(all_.begin(), all_.end(), 0);
  load(rig, observations, all_);
}

// Group by group, so that all lanes of a block have one camera.
void PoseResiduals::load(const Rig& rig, const PoseObservations& observations, std::span<const int> indices) {
  rig_ = &rig;
  has_rays_ = !observations.rays.empty();
  groups_.clear(), blocks_.clear(), rays_.clear(), u_.clear(), v_.clear();
  lane_of_.resize(indices.size());
  const int cameras = has_rays_ ? 1 : static_cast<int>(rig.cameras.size());
  for (int c = 0; c < cameras; ++c) {
    const int begin = static_cast<int>(blocks_.size());
    int lane = begin * kBlockLanes;
    for (size_t k = 0; k < indices.size(); ++k) {
      if (!has_rays_ && observations.camera(indices[k]) != c) continue;
      lane_of_[k] = lane;
      set_lane(observations, indices[k], lane++);
    }
    groups_.push_back({c, begin, static_cast<int>(blocks_.size())});
  }
}

void PoseResiduals::set_lane(const PoseObservations& observations, int i, int lane) {
  const int k = lane % kBlockLanes;
  if (k == 0) {
    blocks_.push_back({});
    if (has_rays_) rays_.push_back({});
    u_.resize(lane + kBlockLanes), v_.resize(lane + kBlockLanes);
  }
  Block& block = blocks_.back();
  for (int c = 0; c < 3; ++c) block.point_in_world[c][k] = observations.points_in_world[i][c];
  const double sigma = observations.sigma(i);
  block.inverse_variance[k] = 1.0 / (sigma * sigma);
  if (has_rays_) {
    set_ray(observations.rays[i], k, &rays_.back());
  } else {
    u_[lane] = observations.pixels[i].x(), v_[lane] = observations.pixels[i].y();
  }
}

// f(block, index of the block) with residuals and derivatives at a pose; squares are over the variance.
template <typename F>
void PoseResiduals::for_each_block(const Rigid3& rig_from_world, F f) const {
  const Eigen::Matrix<double, 3, 3, Eigen::RowMajor> rotation = rig_from_world.rotation.toRotationMatrix();
  ObservationBlock<6> block;
  for (const Group& group : groups_) {
    const auto work = [&](const BlockResidual& residual) {
      for (int b = group.begin; b < group.end; ++b) {
        std::copy_n(&blocks_[b].point_in_world[0][0], 3 * kBlockLanes, &block.x[0][0]);
        transform_points(rotation.data(), rig_from_world.translation.data(), &block);
        residual.evaluate(b * kBlockLanes, true, &block);
        for (int k = 0; k < kBlockLanes; ++k) block.squared[k] *= blocks_[b].inverse_variance[k];
        f(block, b);
      }
    };
    if (has_rays_) {
      work(AngularResidual(rays_.data()));
    } else {
      with_pixel_residual(rig_->cameras[group.camera], u_.data(), v_.data(), work);
    }
  }
}

bool PoseResiduals::evaluate(const Rigid3& rig_from_world, int i, Vector2d* residual,
                             Jacobian* jacobian) const {
  bool valid = false;
  for_each_block(rig_from_world, [&](const ObservationBlock<6>& block, int b) {
    if (lane_of_[i] / kBlockLanes != b) return;
    const int k = lane_of_[i] % kBlockLanes;
    const double inverse_sigma = std::sqrt(blocks_[b].inverse_variance[k]);
    valid = std::isfinite(block.squared[k]);
    const Vector3d in_rig(block.x[0][k], block.x[1][k], block.x[2][k]);
    for (int row = 0; row < 2; ++row) {
      (*residual)[row] = inverse_sigma * block.residual[row][k];
      // d in_rig = v + w x in_rig, and a . (w x p) = w . (p x a).
      const Vector3d a(block.jacobian[3 * row][k], block.jacobian[3 * row + 1][k],
                       block.jacobian[3 * row + 2][k]);
      jacobian->row(row) << inverse_sigma * a.transpose(), inverse_sigma * in_rig.cross(a).transpose();
    }
  });
  return valid;
}

void PoseResiduals::square(const Rigid3& rig_from_world, std::vector<double>* squared) const {
  by_lane_.resize(kBlockLanes * blocks_.size());
  for_each_block(rig_from_world, [&](const ObservationBlock<6>& block, int b) {
    std::copy_n(block.squared, kBlockLanes, &by_lane_[b * kBlockLanes]);
  });
  squared->resize(lane_of_.size());
  for (size_t i = 0; i < lane_of_.size(); ++i) (*squared)[i] = by_lane_[lane_of_[i]];
}

PoseResiduals::NormalEquations PoseResiduals::normal_equations(const Rigid3& rig_from_world,
                                                               const RobustLoss& loss) const {
  NormalEquations result;
  PoseSums<6> sums{};
  for_each_block(rig_from_world, [&](ObservationBlock<6>& block, int b) {
    for (int k = 0; k < kBlockLanes; ++k) {
      const double inverse_variance = blocks_[b].inverse_variance[k];
      const bool valid = block.squared[k] < INFINITY;
      result.failed += inverse_variance > 0 && !valid;
      if (!valid) clear_lane(block, k);
      block.weight[k] = inverse_variance * loss.weight(block.squared[k]);
      result.cost += 0.5 * loss.cost(block.squared[k]);
    }
    pose_terms(block, &sums);
  });
  add_pose_sums(sums, result.hessian.data(), result.gradient.data());
  result.hessian = Matrix6d(result.hessian.selfadjointView<Eigen::Lower>());
  return result;
}

namespace {

// As levenberg_marquardt() takes it.
class PoseMinimisation {
 public:
  PoseMinimisation(const PoseResiduals& residuals, const RobustLoss& loss, const Rigid3& rig_from_world)
      : residuals_(residuals),
        loss_(loss),
        pose_(rig_from_world),
        current_(residuals.normal_equations(pose_, loss)) {}

  double linearize() const { return current_.cost; }
  LmStep solve(double damping) {
    const Vector6d scale = damping * current_.hessian.diagonal();
    Matrix6d damped = current_.hessian;
    damped.diagonal() += scale;
    step_ = damped.ldlt().solve(-current_.gradient);
    const double decrease = 0.5 * (scale.dot(step_.cwiseAbs2()) - current_.gradient.dot(step_));
    return {step_.allFinite() && decrease > 0, decrease};
  }
  LmTrial evaluate(bool) {
    moved_pose_ = retract(pose_, step_);
    moved_ = residuals_.normal_equations(moved_pose_, loss_);
    // A point that leaves the image of the camera must not count as an improvement.
    return {current_.cost, moved_.failed > current_.failed ? INFINITY : moved_.cost};
  }
  void accept() { pose_ = moved_pose_, current_ = moved_; }
  const Rigid3& pose() const { return pose_; }

 private:
  const PoseResiduals& residuals_;
  const RobustLoss& loss_;
  Rigid3 pose_, moved_pose_;
  PoseResiduals::NormalEquations current_, moved_;
  Vector6d step_ = Vector6d::Zero();
};

}  // namespace

int minimise_pose(const PoseResiduals& residuals, const RobustLoss& loss, int max_iterations,
                  Rigid3* rig_from_world) {
  constexpr double kMinDecrease = 1e-7;  // of the cost, relative: far below what the noise resolves
  PoseMinimisation problem(residuals, loss, *rig_from_world);
  const LmSummary summary = levenberg_marquardt(problem, {.max_iterations = max_iterations,
                                                          .min_relative_decrease = kMinDecrease,
                                                          .initial_damping = 1e-6,
                                                          .try_last_step = false});
  *rig_from_world = problem.pose();
  return summary.iterations;
}

}  // namespace raysfm
