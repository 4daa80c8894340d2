#include "raysfm/bundle/residual.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "raysfm/core/median.h"

namespace raysfm {

bool lens_residual(const BalLens& lens, const Eigen::Vector3d& point_in_cam, const Eigen::Vector2d& pixel,
                   Eigen::Vector2d* residual) {
  if (!(point_in_cam.z() < 0)) return false;
  const Eigen::Vector2d p = point_in_cam.head<2>() / -point_in_cam.z();
  const double s = p.squaredNorm();
  *residual = lens.f * (1.0 + s * (lens.k1 + lens.k2 * s)) * p - pixel;
  return residual->allFinite();
}

namespace {

// The camera whose frame a residual is measured in: that of the rig (null) for rays and lenses.
const Camera* camera_of(const BundleProblem& problem, int camera) {
  return problem.rays.empty() && problem.lenses.empty() ? &problem.cameras[camera] : nullptr;
}

// Of a point in the frame of camera_of().
bool residual_in_frame(const BundleProblem& problem, int observation, const BalLens& lens,
                       const Eigen::Vector3d& x, Eigen::Vector2d* residual) {
  const BundleObservation& o = problem.observations[observation];
  if (!problem.rays.empty()) {
    if (!problem.rays[observation].residual(x, residual)) return false;
  } else if (!problem.lenses.empty()) {
    if (!lens_residual(lens, x, o.pixel, residual)) return false;
  } else {
    if (!problem.cameras[o.camera].project(x, residual)) return false;
    *residual -= o.pixel;
  }
  if (!problem.sigmas.empty()) *residual /= problem.sigmas[observation];
  return residual->allFinite();
}

}  // namespace

bool residual_of(const BundleProblem& problem, int observation, const Rigid3& rig_from_world,
                 const BalLens& lens, const Eigen::Vector3d& point, Eigen::Vector2d* residual) {
  const Camera* camera = camera_of(problem, problem.observations[observation].camera);
  const Eigen::Vector3d x_in_rig = rig_from_world * point;
  return residual_in_frame(problem, observation, lens,
                           camera ? camera->rig_from_cam.inverse() * x_in_rig : x_in_rig, residual);
}

bool residual_of(const BundleProblem& problem, int observation, Eigen::Vector2d* residual) {
  const BundleObservation& o = problem.observations[observation];
  const BalLens lens = problem.lenses.empty() ? BalLens{} : problem.lenses[o.pose];
  return residual_of(problem, observation, problem.rig_from_world[o.pose], lens, problem.points[o.point],
                     residual);
}

void ProblemResiduals::load(const BundleProblem& problem) {
  problem_ = problem;
  const bool in_cameras = problem.rays.empty() && problem.lenses.empty();
  cameras_ = in_cameras ? problem.cameras.size() : 1;
  frames_.clear();
  frames_.reserve(cameras_ * problem.rig_from_world.size());
  for (const Rigid3& rig_from_world : problem.rig_from_world) {
    for (size_t c = 0; c < cameras_; ++c) {
      const Rigid3 frame_from_world =
          in_cameras ? problem.cameras[c].rig_from_cam.inverse() * rig_from_world : rig_from_world;
      frames_.push_back({frame_from_world.rotation.toRotationMatrix(), frame_from_world.translation});
    }
  }
}

bool ProblemResiduals::operator()(int observation, Eigen::Vector2d* residual) const {
  const BundleObservation& o = problem_.observations[observation];
  const Frame& frame = frames_[o.pose * cameras_ + (cameras_ > 1 ? o.camera : 0)];
  const BalLens lens = problem_.lenses.empty() ? BalLens{} : problem_.lenses[o.pose];
  return residual_in_frame(problem_, observation, lens,
                           frame.rotation * problem_.points[o.point] + frame.translation, residual);
}

double noise_of(const BundleProblem& problem) {
  ProblemResiduals residuals;
  residuals.load(problem);
  std::vector<double> squared;
  squared.reserve(problem.observations.size());
  for (size_t i = 0; i < problem.observations.size(); ++i) {
    Eigen::Vector2d residual;
    if (problem.uses(i) && residuals(static_cast<int>(i), &residual))
      squared.push_back(residual.squaredNorm());
  }
  return std::sqrt(median_of(&squared) / (2 * std::numbers::ln2));
}

RobustLoss loss_for_noise(const BundleProblem& problem) {
  constexpr double kBegins = 3;  // standard deviations
  constexpr double kNarrowest = 0.1, kWidest = 1;
  return {RobustLoss::Kind::kHuber, std::clamp(kBegins * noise_of(problem), kNarrowest, kWidest)};
}

// 95 % of what least squares tell of pure noise are left (the usual constant of the biweight).
RobustLoss redescending_loss_for_noise(const BundleProblem& problem) {
  constexpr double kBiweight = 4.685, kLeastNoise = 0.01;
  return {RobustLoss::Kind::kTukey, kBiweight * std::max(kLeastNoise, noise_of(problem))};
}

double truncated_cost(const BundleProblem& problem, double most) {
  ProblemResiduals residuals;
  residuals.load(problem);
  double cost = 0;
  for (size_t i = 0; i < problem.observations.size(); ++i) {
    Eigen::Vector2d residual;
    const bool is_seen = residuals(static_cast<int>(i), &residual);
    cost += is_seen ? std::min(most * most, residual.squaredNorm()) : most * most;
  }
  return cost;
}

}  // namespace raysfm
