#include "raysfm/bundle/residual.h"

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

bool plain_residual(const BundleProblem& problem, int observation, const Rigid3& rig_from_world,
                    const BalLens& lens, const Eigen::Vector3d& point, Eigen::Vector2d* residual) {
  const BundleObservation& o = problem.observations[observation];
  const Eigen::Vector3d x_in_rig = rig_from_world * point;
  if (!problem.rays.empty()) return problem.rays[observation].residual(x_in_rig, residual);
  if (!problem.lenses.empty()) return lens_residual(lens, x_in_rig, o.pixel, residual);
  const Camera& camera = problem.cameras[o.camera];
  if (!camera.project(camera.rig_from_cam.inverse() * x_in_rig, residual)) return false;
  *residual -= o.pixel;
  return residual->allFinite();
}

}  // namespace

bool residual_of(const BundleProblem& problem, int observation, const Rigid3& rig_from_world,
                 const BalLens& lens, const Eigen::Vector3d& point, Eigen::Vector2d* residual) {
  if (!plain_residual(problem, observation, rig_from_world, lens, point, residual)) return false;
  if (!problem.sigmas.empty()) *residual /= problem.sigmas[observation];
  return true;
}

bool residual_of(const BundleProblem& problem, int observation, Eigen::Vector2d* residual) {
  const BundleObservation& o = problem.observations[observation];
  const BalLens lens = problem.lenses.empty() ? BalLens{} : problem.lenses[o.pose];
  return residual_of(problem, observation, problem.rig_from_world[o.pose], lens, problem.points[o.point],
                     residual);
}

}  // namespace raysfm
