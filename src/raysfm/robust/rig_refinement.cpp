#include "raysfm/robust/rig_refinement.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <limits>

#include "raysfm/geometry/ray.h"
#include "raysfm/robust/three_view_refinement.h"

namespace raysfm {

using Eigen::Matrix3d;
using Eigen::Vector2d;
using Eigen::Vector3d;
using Matrix12d = Eigen::Matrix<double, 12, 12>;
using Vector12d = Eigen::Matrix<double, 12, 1>;
using Matrix23d = Eigen::Matrix<double, 2, 3>;

namespace {

// Rotation and translation of the three views, ready for many points.
struct Frames {
  std::array<Matrix3d, 3> r;
  std::array<Vector3d, 3> t;
  explicit Frames(const RigMotion& motion)
      : r{Matrix3d::Identity(), motion.rig1_from_rig0.rotation.toRotationMatrix(),
          motion.rig2_from_rig0.rotation.toRotationMatrix()},
        t{Vector3d::Zero(), motion.rig1_from_rig0.translation, motion.rig2_from_rig0.translation} {}
};

RigMotion apply(const RigMotion& motion, const Vector12d& step, bool hold_scale) {
  RigMotion next{retract(motion.rig1_from_rig0, step.head<6>()),
                 retract(motion.rig2_from_rig0, step.tail<6>())};
  if (hold_scale) {
    Vector3d& t = next.rig2_from_rig0.translation;
    t *= motion.rig2_from_rig0.translation.norm() / t.norm();
  }
  return next;
}

// The step of least damped cost; with hold_scale among those that keep |t2| to first order: a turn of the
// step of t2 takes its direction to the last axis of three, which is left out.
Vector12d solve(const Matrix12d& hessian, const Vector12d& gradient, const RigMotion& motion,
                bool hold_scale) {
  if (!hold_scale) return hessian.ldlt().solve(-gradient);
  Eigen::Matrix<double, 12, 11> basis = Eigen::Matrix<double, 12, 11>::Zero();
  basis.topLeftCorner<6, 6>().setIdentity();
  basis.block<3, 2>(6, 6) = tangent_rows(motion.rig2_from_rig0.translation.normalized()).transpose();
  basis.bottomRightCorner<3, 3>().setIdentity();
  const Eigen::Matrix<double, 11, 11> reduced = basis.transpose() * hessian * basis;
  return basis * reduced.ldlt().solve(-(basis.transpose() * gradient));
}

}  // namespace

void RigRefiner::start(const RigTable& table, std::span<const int> active, const RigMotion& motion) {
  const Frames frames(motion);
  points_.resize(active.size());
  for (size_t k = 0; k < active.size(); ++k) {
    const RigTable::Point& in = table.points[active[k]];
    const ObservedRay &ray0 = table.rays[in.primary[0]], &ray2 = table.rays[in.primary[2]];
    Point& point = points_[k];
    point.begin = in.begin, point.end = in.end;
    point.origin = ray0.origin;
    point.direction = ray0.direction;
    point.inverse_distance = inverse_distance(
        frames.r[2], frames.r[2] * ray0.origin + frames.t[2] - ray2.origin, ray0.direction, ray2.direction);
  }
}

double RigRefiner::cost(const RigTable& table, const RigMotion& motion,
                        const std::vector<Point>& points) const {
  const Frames frames(motion);
  double sum = 0;
  for (const Point& point : points) {
    for (int i = point.begin; i < point.end; ++i) {
      const ObservedRay& ray = table.rays[i];
      const int v = table.views[i];
      const Vector3d seen = frames.r[v] * point.direction +
                            point.inverse_distance * (frames.r[v] * point.origin + frames.t[v] - ray.origin);
      const double along = ray.direction.dot(seen);
      if (!(along > 0)) return std::numeric_limits<double>::infinity();
      sum += (ray.tangents * seen / along).squaredNorm();
    }
  }
  return sum;
}

// The reduced system of the poses, the points eliminated, where the cost is finite:
//   [ U  W ] [poses ]   [-g]
//   [ W' V ] [points] = [-h]     (U - W V^-1 W') poses = -g + W V^-1 h,  V block diagonal 3x3.
void RigRefiner::linearise(const RigTable& table, const RigMotion& motion, double damping, Matrix12d* hessian,
                           Vector12d* gradient) {
  const Frames frames(motion);
  Matrix12d u = Matrix12d::Zero(), reduction = Matrix12d::Zero();
  Vector12d g = Vector12d::Zero();
  for (Point& point : points_) {
    Matrix3d v_block = Matrix3d::Zero();
    point.by_poses.setZero();
    point.gradient.setZero();
    const Matrix23d direction_tangents = tangent_rows(point.direction);
    for (int i = point.begin; i < point.end; ++i) {
      const ObservedRay& ray = table.rays[i];
      const int v = table.views[i];
      const Vector3d anchor = frames.r[v] * point.origin + frames.t[v];
      const Vector3d turned = frames.r[v] * point.direction;
      const Vector3d seen = turned + point.inverse_distance * (anchor - ray.origin);
      const double along = ray.direction.dot(seen);
      const Vector2d r = ray.tangents * seen / along;
      const Matrix23d by_seen = (ray.tangents - r * ray.direction.transpose()) / along;
      Matrix23d by_point;
      by_point.leftCols<2>() = by_seen * (frames.r[v] * direction_tangents.transpose());
      by_point.col(2) = by_seen * (anchor - ray.origin);
      v_block += by_point.transpose() * by_point;
      point.gradient += by_point.transpose() * r;
      if (v == 0) continue;
      // Rotation w and translation v move what is seen by w x (turned + rho anchor) + rho v.
      const Vector3d moved = turned + point.inverse_distance * anchor;
      Eigen::Matrix<double, 2, 6> by_pose;
      by_pose.leftCols<3>() = point.inverse_distance * by_seen;
      for (int row = 0; row < 2; ++row) by_pose.block<1, 3>(row, 3) = moved.cross(Vector3d(by_seen.row(row)));
      const int begin = 6 * (v - 1);
      u.block<6, 6>(begin, begin) += by_pose.transpose() * by_pose;
      g.segment<6>(begin) += by_pose.transpose() * r;
      point.by_poses.block<3, 6>(0, begin) += by_point.transpose() * by_pose;
    }
    v_block.diagonal() *= 1 + damping;
    v_block.diagonal().array() += 1e-12 * v_block.trace();  // a point on the baseline has no distance
    point.inverse_hessian = v_block.inverse();
    const Eigen::Matrix<double, 3, 12> eliminated = point.inverse_hessian.lazyProduct(point.by_poses);
    reduction += point.by_poses.transpose().lazyProduct(eliminated);
    g -= eliminated.transpose().lazyProduct(point.gradient);
  }
  u.diagonal() *= 1 + damping;
  *hessian = u - reduction;
  *gradient = g;
}

double RigRefiner::refine(const RigTable& table, std::span<const int> active, const Options& options,
                          RigMotion* motion) {
  if (active.size() < 6) return std::numeric_limits<double>::infinity();
  start(table, active, *motion);
  double damping = 1e-4;
  double current = cost(table, *motion, points_);
  Matrix12d hessian;
  Vector12d gradient;
  for (int iteration = 0; iteration < options.max_iterations && std::isfinite(current); ++iteration) {
    linearise(table, *motion, damping, &hessian, &gradient);
    const Vector12d step = solve(hessian, gradient, *motion, options.hold_scale);
    if (!step.allFinite()) break;
    const RigMotion next = apply(*motion, step, options.hold_scale);
    // Where the scale is hard to see, the steps run along a valley in which translations grow as inverse
    // distances shrink: their product has to stay, to second order too.
    const double growth = next.rig2_from_rig0.translation.norm() / motion->rig2_from_rig0.translation.norm();
    const double shrink = growth > 0.1 && growth < 10 ? 1 / growth : 1.0;
    moved_ = points_;
    for (Point& point : moved_) {
      const Vector3d change = -(point.inverse_hessian * (point.gradient + point.by_poses * step));
      point.direction =
          (point.direction + tangent_rows(point.direction).transpose() * change.head<2>()).normalized();
      point.inverse_distance += shrink * change[2];
    }
    const double after = cost(table, next, moved_);
    if (!(after < current)) {
      damping *= 30;
      if (damping > 1e6) break;
      continue;
    }
    const bool converged = after > (1 - options.min_decrease) * current;
    *motion = next;
    points_.swap(moved_);
    current = after;
    damping = std::max(1e-8, 0.1 * damping);
    if (converged) break;
  }
  return current;
}

}  // namespace raysfm
