#include "raysfm/robust/pose_refinement.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

namespace raysfm {

using Eigen::Matrix3d;
using Eigen::Vector2d;
using Eigen::Vector3d;

PoseResiduals::PoseResiduals(const Rig& rig, const PoseObservations& observations)
    : rig_(rig), observations_(observations) {
  for (const Camera& camera : rig.cameras) {
    const Rigid3 cam_from_rig = camera.rig_from_cam.inverse();
    cam_from_rig_rotation_.push_back(cam_from_rig.rotation.toRotationMatrix());
    cam_from_rig_translation_.push_back(cam_from_rig.translation);
  }
}

bool PoseResiduals::pixel_residual(const Vector3d& in_rig, int i, Vector2d* residual,
                                   Eigen::Matrix<double, 2, 3>* by_point) const {
  const int c = observations_.camera(i);
  const Vector3d in_cam = cam_from_rig_rotation_[c] * in_rig + cam_from_rig_translation_[c];
  Vector2d pixel;
  if (!rig_.cameras[c].project(in_cam, &pixel, by_point)) return false;
  *residual = pixel - observations_.pixels[i];
  if (by_point) *by_point = (*by_point * cam_from_rig_rotation_[c]).eval();
  return true;
}

bool PoseResiduals::evaluate(const Matrix3d& rig_from_world_rotation,
                             const Vector3d& rig_from_world_translation, int i, Vector2d* residual,
                             Jacobian* jacobian) const {
  const Vector3d in_rig =
      rig_from_world_rotation * observations_.points_in_world[i] + rig_from_world_translation;
  Eigen::Matrix<double, 2, 3> by_point;
  if (!observations_.rays.empty()) {
    if (!observations_.rays[i].residual(in_rig, residual, jacobian ? &by_point : nullptr)) return false;
  } else if (!pixel_residual(in_rig, i, residual, jacobian ? &by_point : nullptr)) {
    return false;
  }
  if (!observations_.sigmas.empty()) {
    const double inverse = 1.0 / observations_.sigmas[i];
    *residual *= inverse;
    if (jacobian) by_point *= inverse;
  }
  if (jacobian) {
    // d in_rig = v + w x in_rig, and a . (w x p) = w . (p x a).
    jacobian->leftCols<3>() = by_point;
    for (int row = 0; row < 2; ++row) {
      const Vector3d a = jacobian->block<1, 3>(row, 0);
      jacobian->block<1, 3>(row, 3) = in_rig.cross(a);
    }
  }
  return true;
}

PoseResiduals::NormalEquations PoseResiduals::normal_equations(const Rigid3& rig_from_world,
                                                               std::span<const int> active,
                                                               const RobustLoss& loss) const {
  const Matrix3d rotation = rig_from_world.rotation.toRotationMatrix();
  NormalEquations sum;
  Vector2d r;
  Jacobian j;
  for (const int i : active) {
    if (!evaluate(rotation, rig_from_world.translation, i, &r, &j)) {
      ++sum.failed;
      continue;
    }
    const double squared = r.squaredNorm();
    sum.cost += 0.5 * loss.cost(squared);
    const Eigen::Matrix<double, 6, 2> weighted = loss.weight(squared) * j.transpose();
    sum.hessian += weighted.lazyProduct(j);
    sum.gradient += weighted.lazyProduct(r);
  }
  return sum;
}

int minimise_pose(const PoseResiduals& residuals, std::span<const int> active, const RobustLoss& loss,
                  int max_iterations, Rigid3* rig_from_world) {
  constexpr double kMinDecrease = 1e-7;  // of the cost, relative: far below what the noise resolves
  double damping = 1e-6;
  auto current = residuals.normal_equations(*rig_from_world, active, loss);
  for (int iteration = 1; iteration <= max_iterations; ++iteration) {
    Matrix6d damped = current.hessian;
    damped.diagonal() *= 1 + damping;
    const Vector6d step = damped.ldlt().solve(-current.gradient);
    if (!step.allFinite()) return iteration;
    const double predicted = -0.5 * current.gradient.dot(step);
    if (!(predicted > kMinDecrease * current.cost)) return iteration;
    const Rigid3 next_pose = retract(*rig_from_world, step);
    const auto next = residuals.normal_equations(next_pose, active, loss);
    // A point that leaves the image of the camera must not count as an improvement.
    if (next.failed > current.failed || !(next.cost < current.cost)) {
      damping = std::max(1e-4, damping * 10);
      if (damping > 1e8) return iteration;
      continue;
    }
    *rig_from_world = next_pose;
    current = next;
    damping = std::max(1e-9, damping * 0.1);
  }
  return max_iterations;
}

}  // namespace raysfm
