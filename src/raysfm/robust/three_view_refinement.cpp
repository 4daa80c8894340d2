#include "raysfm/robust/three_view_refinement.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <cstring>

#include "raysfm/geometry/ray.h"

namespace raysfm {

using Eigen::Matrix3d;
using Eigen::Vector2d;
using Eigen::Vector3d;
using Matrix11d = Eigen::Matrix<double, 11, 11>;
using Vector11d = Eigen::Matrix<double, 11, 1>;

namespace {

// The step of the eleven parameters: tangent of pose 1; of pose 2 two for the direction of the translation
// and three for the rotation.
ThreeViewMotion apply(const ThreeViewMotion& motion, const Vector11d& step) {
  ThreeViewMotion next;
  next.cam1_from_cam0 = retract(motion.cam1_from_cam0, step.head<6>());
  Eigen::Matrix<double, 6, 1> step2;
  step2.head<3>() = tangent_rows(motion.cam2_from_cam0.translation).transpose() * step.segment<2>(6);
  step2.tail<3>() = step.tail<3>();
  next.cam2_from_cam0 = retract(motion.cam2_from_cam0, step2);
  next.cam2_from_cam0.translation.normalize();
  return next;
}

ThreeViewPoses poses_of(const ThreeViewMotion& motion) {
  ThreeViewPoses poses;
  const std::array<const Rigid3*, 2> views = {&motion.cam1_from_cam0, &motion.cam2_from_cam0};
  for (int v = 0; v < 2; ++v) {
    Eigen::Map<Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(poses.rotations[v].data()) =
        views[v]->rotation.toRotationMatrix();
    Eigen::Map<Vector3d>(poses.translations[v].data()) = views[v]->translation;
  }
  const Eigen::Matrix<double, 2, 3> tangents = tangent_rows(motion.cam2_from_cam0.translation);
  for (int row = 0; row < 2; ++row)
    Eigen::Map<Vector3d>(poses.baseline_tangents[row].data()) = tangents.row(row);
  return poses;
}

Matrix11d symmetric(const std::array<double, kHessianNumbers>& upper) {
  Matrix11d matrix;
  int at = 0;
  for (int row = 0; row < kPoseNumbers; ++row) {
    for (int column = row; column < kPoseNumbers; ++column)
      matrix(row, column) = matrix(column, row) = upper[at++];
  }
  return matrix;
}

}  // namespace

double inverse_distance(const Matrix3d& rotation, const Vector3d& translation, const Vector3d& b0,
                        const Vector3d& b2) {
  const Vector3d c = b2.cross(translation);
  const double c2 = c.squaredNorm();
  if (!(c2 > 1e-16)) return 0;
  return std::max(0.0, -b2.cross(rotation * b0).dot(c) / c2);
}

void ThreeViewRefiner::start(const ThreeViewBearings& bearings, std::span<const int> active,
                             const ThreeViewMotion& motion) {
  const Matrix3d rotation = motion.cam2_from_cam0.rotation.toRotationMatrix();
  const size_t groups = (active.size() + kPointLanes - 1) / kPointLanes;
  points_.resize(groups);
  for (size_t k = 0; k < groups * kPointLanes; ++k) {
    ThreeViewPoints& group = points_[k / kPointLanes];
    const size_t lane = k % kPointLanes;
    const bool counts = k < active.size();
    const int i = active[counts ? k : 0];
    for (int v = 0; v < 3; ++v) {
      const Vector3d& bearing = bearings.views[v][i];
      const Eigen::Matrix<double, 2, 3> tangents = tangent_rows(bearing);
      for (int c = 0; c < 3; ++c) {
        group.bearings[v][c][lane] = bearing[c];
        for (int row = 0; row < 2; ++row) group.tangents[v][row][c][lane] = counts ? tangents(row, c) : 0;
      }
    }
    group.place[0][lane] = group.place[1][lane] = 0;
    group.place[2][lane] = inverse_distance(rotation, motion.cam2_from_cam0.translation, bearings.views[0][i],
                                            bearings.views[2][i]);
  }
}

double ThreeViewRefiner::refine(const ThreeViewBearings& bearings, std::span<const int> active,
                                int max_iterations, ThreeViewMotion* motion) {
  if (active.size() < 5) return std::numeric_limits<double>::infinity();
  start(bearings, active, *motion);
  double damping = 1e-4;
  const int groups = static_cast<int>(points_.size());
  ThreeViewPoses poses = poses_of(*motion);
  double current = three_view_cost(poses, points_.data(), groups, false);
  ThreeViewSums sums;
  std::array<double, kPoseNumbers> step_numbers;
  for (int iteration = 0; iteration < max_iterations && std::isfinite(current); ++iteration) {
    linearise_three_views(poses, damping, points_.data(), groups, &sums);
    Eigen::Map<Vector11d> step(step_numbers.data());
    step = symmetric(sums.hessian).ldlt().solve(-Eigen::Map<const Vector11d>(sums.gradient.data()));
    if (!step.allFinite()) break;
    const ThreeViewMotion next = apply(*motion, step);
    const ThreeViewPoses next_poses = poses_of(next);
    move_three_view_points(step_numbers, points_.data(), groups);
    const double after = three_view_cost(next_poses, points_.data(), groups, true);
    if (!(after < current)) {
      damping *= 30;
      if (damping > 1e6) break;
      continue;
    }
    const bool converged = after > (1 - 1e-5) * current;
    *motion = next;
    poses = next_poses;
    for (ThreeViewPoints& group : points_) std::memcpy(group.place, group.moved, sizeof group.place);
    current = after;
    damping = std::max(1e-8, 0.1 * damping);
    if (converged) break;
  }
  return current;
}

}  // namespace raysfm
