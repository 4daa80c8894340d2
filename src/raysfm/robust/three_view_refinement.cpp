#include "raysfm/robust/three_view_refinement.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>

#include "raysfm/geometry/ray.h"

namespace raysfm {

using Eigen::Matrix3d;
using Eigen::Vector2d;
using Eigen::Vector3d;
using Matrix11d = Eigen::Matrix<double, 11, 11>;
using Vector11d = Eigen::Matrix<double, 11, 1>;

namespace {

// Residual of a view: the tangent of the angle between a bearing and where the point is seen. False behind.
bool residual(const Eigen::Matrix<double, 2, 3>& tangents, const Vector3d& bearing, const Vector3d& seen,
              Vector2d* r) {
  const double along = bearing.dot(seen);
  if (!(along > 0)) return false;
  *r = tangents * seen / along;
  return true;
}

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
  points_.resize(active.size());
  for (size_t k = 0; k < active.size(); ++k) {
    Point& point = points_[k];
    for (int v = 0; v < 3; ++v) {
      point.bearings[v] = bearings.views[v][active[k]];
      point.tangents[v] = tangent_rows(point.bearings[v]);
    }
    point.direction = point.bearings[0];
    point.inverse_distance =
        inverse_distance(rotation, motion.cam2_from_cam0.translation, point.bearings[0], point.bearings[2]);
  }
}

double ThreeViewRefiner::cost(const ThreeViewMotion& motion, const std::vector<Point>& points) const {
  const Rigid3* poses[3] = {nullptr, &motion.cam1_from_cam0, &motion.cam2_from_cam0};
  double sum = 0;
  for (const Point& point : points) {
    for (int v = 0; v < 3; ++v) {
      const Vector3d seen = v == 0 ? point.direction
                                   : Vector3d(poses[v]->rotation * point.direction +
                                              point.inverse_distance * poses[v]->translation);
      Vector2d r;
      if (!residual(point.tangents[v], point.bearings[v], seen, &r)) {
        return std::numeric_limits<double>::infinity();
      }
      sum += r.squaredNorm();
    }
  }
  return sum;
}

// The reduced system of the poses, the points eliminated, where the cost is finite:
//   [ U  W ] [poses ]   [-g]
//   [ W' V ] [points] = [-h]     (U - W V^-1 W') poses = -g + W V^-1 h,  V block diagonal 3x3.
void ThreeViewRefiner::linearise(const ThreeViewMotion& motion, double damping, Matrix11d* hessian,
                                 Vector11d* gradient) {
  const std::array<const Rigid3*, 3> poses = {nullptr, &motion.cam1_from_cam0, &motion.cam2_from_cam0};
  std::array<Matrix3d, 3> rotations = {Matrix3d::Identity()};
  for (int v = 1; v < 3; ++v) rotations[v] = poses[v]->rotation.toRotationMatrix();
  const Eigen::Matrix<double, 2, 3> baseline_tangents = tangent_rows(motion.cam2_from_cam0.translation);
  Matrix11d u = Matrix11d::Zero();
  Matrix11d reduction = Matrix11d::Zero();
  Vector11d g = Vector11d::Zero();
  for (Point& point : points_) {
    Matrix3d v_block = Matrix3d::Zero();
    point.by_poses.setZero();
    point.gradient.setZero();
    const Eigen::Matrix<double, 2, 3> direction_tangents = tangent_rows(point.direction);
    for (int v = 0; v < 3; ++v) {
      const Vector3d t = v == 0 ? Vector3d::Zero() : poses[v]->translation;
      const Vector3d seen = rotations[v] * point.direction + point.inverse_distance * t;
      Vector2d r = Vector2d::Zero();
      residual(point.tangents[v], point.bearings[v], seen, &r);
      const Eigen::Matrix<double, 2, 3> by_seen =
          (point.tangents[v] - r * point.bearings[v].transpose()) / point.bearings[v].dot(seen);
      Eigen::Matrix<double, 2, 3> by_point;
      by_point.leftCols<2>() = by_seen * (rotations[v] * direction_tangents.transpose());
      by_point.col(2) = by_seen * t;
      v_block += by_point.transpose() * by_point;
      point.gradient += by_point.transpose() * r;
      if (v == 0) continue;
      // Rotation w and translation v move what is seen by w x seen + rho v.
      Eigen::Matrix<double, 2, 3> by_rotation;
      for (int row = 0; row < 2; ++row) by_rotation.row(row) = seen.cross(Vector3d(by_seen.row(row)));
      const auto add = [&]<int kBegin, int kSize>(const Eigen::Matrix<double, 2, kSize>& by_pose) {
        u.block<kSize, kSize>(kBegin, kBegin) += by_pose.transpose() * by_pose;
        g.segment<kSize>(kBegin) += by_pose.transpose() * r;
        point.by_poses.block<3, kSize>(0, kBegin) = by_point.transpose() * by_pose;
      };
      if (v == 1) {
        Eigen::Matrix<double, 2, 6> by_pose;
        by_pose << point.inverse_distance * by_seen, by_rotation;
        add.template operator()<0, 6>(by_pose);
      } else {
        Eigen::Matrix<double, 2, 5> by_pose;
        by_pose << point.inverse_distance * by_seen * baseline_tangents.transpose(), by_rotation;
        add.template operator()<6, 5>(by_pose);
      }
    }
    v_block.diagonal() *= 1 + damping;
    v_block.diagonal().array() += 1e-12;  // a point on the baseline has no distance
    point.inverse_hessian = v_block.inverse();
    const Eigen::Matrix<double, 3, 11> eliminated = point.inverse_hessian.lazyProduct(point.by_poses);
    reduction += point.by_poses.transpose().lazyProduct(eliminated);
    g -= eliminated.transpose().lazyProduct(point.gradient);
  }
  u.diagonal() *= 1 + damping;
  *hessian = u - reduction;
  *gradient = g;
}

double ThreeViewRefiner::refine(const ThreeViewBearings& bearings, std::span<const int> active,
                                int max_iterations, ThreeViewMotion* motion) {
  if (active.size() < 5) return std::numeric_limits<double>::infinity();
  start(bearings, active, *motion);
  double damping = 1e-4;
  double current = cost(*motion, points_);
  Matrix11d hessian;
  Vector11d gradient;
  for (int iteration = 0; iteration < max_iterations && std::isfinite(current); ++iteration) {
    linearise(*motion, damping, &hessian, &gradient);
    const Vector11d step = hessian.ldlt().solve(-gradient);
    if (!step.allFinite()) break;
    const ThreeViewMotion next = apply(*motion, step);
    moved_ = points_;
    for (Point& point : moved_) {
      const Vector3d change = -(point.inverse_hessian * (point.gradient + point.by_poses * step));
      point.direction =
          (point.direction + tangent_rows(point.direction).transpose() * change.head<2>()).normalized();
      point.inverse_distance += change[2];
    }
    const double after = cost(next, moved_);
    if (!(after < current)) {
      damping *= 30;
      if (damping > 1e6) break;
      continue;
    }
    const bool converged = after > (1 - 1e-5) * current;
    *motion = next;
    points_.swap(moved_);
    current = after;
    damping = std::max(1e-8, 0.1 * damping);
    if (converged) break;
  }
  return current;
}

}  // namespace raysfm
