#include "raysfm/uncalibrated/video_resection.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <cmath>
#include <limits>

#include "raysfm/geometry/rotation.h"
#include "raysfm/lenses/uncalibrated_scene.h"
#include "raysfm/optim/levenberg_marquardt.h"
#include "raysfm/optim/robust_loss.h"
#include "raysfm/robust/absolute_pose.h"

namespace raysfm {
namespace {

using Vector9d = Eigen::Matrix<double, 9, 1>;
using Matrix9d = Eigen::Matrix<double, 9, 9>;

constexpr double kWiderSearch =
    3;  // a zoom between two views makes inliers of the old lens worse than of the new

// Pose, log focal length and principal point of one view, as levenberg_marquardt() takes it.
class LensPoseProblem {
 public:
  LensPoseProblem(std::span<const Eigen::Vector3d> points, std::span<const Eigen::Vector2d> pixels,
                  const std::vector<uint8_t>& used, const Lens& prior, const LensResectionOptions& options)
      : points_(points), pixels_(pixels), used_(used), prior_(prior), options_(options) {}

  void start(const Rigid3& pose, const Lens& lens) { pose_ = pose, lens_ = lens; }
  const Rigid3& pose() const { return pose_; }
  const Lens& lens() const { return lens_; }
  const Matrix9d& hessian() const { return hessian_; }

  double linearize() {
    hessian_.setZero();
    gradient_.setZero();
    return cost(pose_, lens_, &hessian_, &gradient_);
  }
  LmStep solve(double damping) {
    Matrix9d damped = hessian_;
    damped.diagonal() *= 1 + damping;
    const Eigen::LDLT<Matrix9d> ldlt(damped);
    if (ldlt.info() != Eigen::Success || !ldlt.isPositive()) return {};
    step_ = -ldlt.solve(gradient_);
    if (!step_.allFinite()) return {};
    return {true, -(gradient_.dot(step_) + 0.5 * step_.dot(hessian_ * step_))};
  }
  LmTrial evaluate(bool linearize) {
    trial_pose_ = retract(pose_, step_.head<6>());
    trial_lens_ = lens_;
    trial_lens_.fx *= std::exp(step_[6]);
    trial_lens_.fy *= std::exp(step_[6]);
    trial_lens_.cx += step_[7];
    trial_lens_.cy += step_[8];
    const double before = cost(pose_, lens_, nullptr, nullptr);
    if (!linearize) return {before, cost(trial_pose_, trial_lens_, nullptr, nullptr)};
    Matrix9d hessian = Matrix9d::Zero();
    Vector9d gradient = Vector9d::Zero();
    const double after = cost(trial_pose_, trial_lens_, &hessian, &gradient);
    hessian_ = hessian, gradient_ = gradient;
    return {before, after, true};
  }
  void accept() { pose_ = trial_pose_, lens_ = trial_lens_; }

 private:
  // Huber's loss by reweighting; a point behind the camera makes the cost infinite.
  double cost(const Rigid3& pose, const Lens& lens, Matrix9d* hessian, Vector9d* gradient) const {
    const RobustLoss loss{RobustLoss::Kind::kHuber, options_.max_error_px / 3};
    double sum = 0;
    for (size_t i = 0; i < points_.size(); ++i) {
      if (!used_[i]) continue;
      const Eigen::Vector3d x = pose * points_[i];
      if (!(x.z() > 0)) return std::numeric_limits<double>::infinity();
      const Eigen::Vector2d m = x.hnormalized();
      const Eigen::Vector2d residual = lens.pixel(m) - pixels_[i];
      const double square = residual.squaredNorm();
      sum += 0.5 * loss.cost(square);
      if (!hessian) continue;
      Eigen::Matrix<double, 2, 3> by_point;
      by_point << lens.fx, lens.skew, -(lens.fx * m.x() + lens.skew * m.y()), 0, lens.fy, -lens.fy * m.y();
      by_point /= x.z();
      Eigen::Matrix<double, 2, 9> jacobian;
      jacobian.leftCols<3>() = by_point;
      for (int c = 0; c < 3; ++c) jacobian.col(3 + c) = by_point * Eigen::Vector3d::Unit(c).cross(x);
      jacobian.col(6) = Eigen::Vector2d(lens.fx * m.x(), lens.fy * m.y());
      jacobian.rightCols<2>().setIdentity();
      const double weight = loss.weight(square);
      hessian->noalias() += weight * jacobian.transpose() * jacobian;
      gradient->noalias() += weight * jacobian.transpose() * residual;
    }
    const double weight = 1 / (options_.principal_point_sigma_px * options_.principal_point_sigma_px);
    const Eigen::Vector2d off(lens.cx - prior_.cx, lens.cy - prior_.cy);
    if (hessian) {
      hessian->diagonal().tail<2>().array() += weight;
      gradient->tail<2>() += weight * off;
    }
    return sum + 0.5 * weight * off.squaredNorm();
  }

  std::span<const Eigen::Vector3d> points_;
  std::span<const Eigen::Vector2d> pixels_;
  const std::vector<uint8_t>& used_;
  const Lens prior_;
  const LensResectionOptions& options_;
  Rigid3 pose_, trial_pose_;
  Lens lens_, trial_lens_;
  Matrix9d hessian_ = Matrix9d::Zero();
  Vector9d gradient_ = Vector9d::Zero(), step_ = Vector9d::Zero();
};

void judge(std::span<const Eigen::Vector3d> points, std::span<const Eigen::Vector2d> pixels, double max_error,
           LensResection* result) {
  result->inlier.assign(points.size(), 0);
  result->inlier_count = 0;
  for (size_t i = 0; i < points.size(); ++i) {
    const Eigen::Vector2d r = pixel_residual(result->cam_from_world, result->lens, {}, points[i], pixels[i]);
    result->inlier[i] = r.norm() < max_error;
    result->inlier_count += result->inlier[i];
  }
}

// Refines pose and lens over the inliers, which are found anew in between.
void refine(std::span<const Eigen::Vector3d> points, std::span<const Eigen::Vector2d> pixels,
            const Lens& prior, const LensResectionOptions& options, LensResection* result) {
  constexpr int kRounds = 3;
  Matrix9d hessian = Matrix9d::Zero();
  for (int round = 0; round < kRounds; ++round) {
    LensPoseProblem problem(points, pixels, result->inlier, prior, options);
    problem.start(result->cam_from_world, result->lens);
    levenberg_marquardt(problem, {.max_iterations = 20, .min_relative_decrease = 1e-6});
    result->cam_from_world = problem.pose();
    result->lens = problem.lens();
    problem.linearize();
    hessian = problem.hessian();
    judge(points, pixels, options.max_error_px, result);
  }
  const Matrix9d covariance = hessian.ldlt().solve(Matrix9d::Identity());
  double square = 0;
  for (size_t i = 0; i < points.size(); ++i) {
    if (!result->inlier[i]) continue;
    square += pixel_residual(result->cam_from_world, result->lens, {}, points[i], pixels[i]).squaredNorm();
  }
  const double sigma = std::sqrt(square / std::max(1, 2 * result->inlier_count - 9));
  const Eigen::Vector3d deviation = sigma * covariance.diagonal().tail<3>().cwiseMax(0).cwiseSqrt();
  result->lens_sigma << deviation[0] * result->lens.fx, deviation[0] * result->lens.fy, deviation[1],
      deviation[2], 0;
}

}  // namespace

bool resect_with_lens(std::span<const Eigen::Vector3d> points, std::span<const Eigen::Vector2d> pixels,
                      const Rigid3& near_cam_from_world, const Lens& near_lens,
                      const LensResectionOptions& options, LensResection* result) {
  Rig rig;
  rig.cameras.resize(1);
  rig.cameras[0].model = Pinhole{near_lens.fx, near_lens.fy, near_lens.cx, near_lens.cy};
  PoseOptions pose_options;
  pose_options.max_error_px = options.max_error_px * (options.zooming ? kWiderSearch : 1);
  pose_options.min_inliers = options.min_inliers;
  pose_options.seed = options.seed;
  pose_options.stream = options.stream;
  PoseEstimator estimator;
  PoseEstimate pose;
  estimator.estimate(rig, {.points_in_world = points, .pixels = pixels}, &near_cam_from_world, pose_options,
                     &pose);
  if (!pose.ok()) return false;
  result->cam_from_world = pose.rig_from_world;
  result->lens = near_lens;
  result->lens_sigma.setConstant(std::numeric_limits<double>::infinity());
  result->inlier = pose.inlier;
  if (options.zooming) refine(points, pixels, near_lens, options, result);
  judge(points, pixels, options.max_error_px, result);
  return result->inlier_count >= options.min_inliers && 2 * result->inlier_count > int(points.size());
}

}  // namespace raysfm
