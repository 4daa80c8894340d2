#include "raysfm/bundle/gauge.h"

#include <Eigen/Eigenvalues>
#include <cmath>

namespace raysfm {
namespace {

constexpr int kMost = 7;  // translation, rotation, scale
constexpr double kZero = 1e-11;

using Matrix7 = Eigen::Matrix<double, kMost, kMost>;

// What the seven motions of the world about a centre do to the free poses and points.
template <int N>
Gauge world_motions(const BundleProblem& problem, const ObservationLayout& layout) {
  Eigen::Vector3d center = Eigen::Vector3d::Zero();
  for (int p : layout.points) center += problem.points[p] / layout.points.size();
  Gauge gauge;
  gauge.poses = Eigen::MatrixXd::Zero(N * layout.poses.size(), kMost);
  gauge.points.resize(3 * layout.points.size(), kMost);
  for (size_t i = 0; i < layout.poses.size(); ++i) {
    const Rigid3& pose = problem.rig_from_world[layout.poses[i]];
    const Eigen::Matrix3d r = pose.rotation.toRotationMatrix();
    const Eigen::Vector3d t = pose * center;
    auto rows = gauge.poses.middleRows<6>(N * static_cast<Eigen::Index>(i));
    // x moves to x + a + w x (x - c) + s (x - c), and R' x' + t' = (1 + s) (R x + t).
    rows.topLeftCorner<3, 3>() = -r;
    rows.block<3, 3>(0, 3) = -skew(t) * r;
    rows.block<3, 3>(3, 3) = -r;
    rows.block<3, 1>(0, 6) = t;
  }
  for (size_t p = 0; p < layout.points.size(); ++p) {
    const Eigen::Vector3d d = problem.points[layout.points[p]] - center;
    auto rows = gauge.points.middleRows<3>(3 * static_cast<Eigen::Index>(p));
    rows.leftCols<3>().setIdentity();
    rows.middleCols<3>(3) = -skew(d);
    rows.col(6) = d;
  }
  return gauge;
}

template <int N>
using Symmetric = Eigen::Matrix<double, N, N>;

template <int N>
Symmetric<N> pose_block(const SchurSystem<N>& system, int i) {
  return Eigen::Map<const Symmetric<N>>(system.pose(i).u).template selfadjointView<Eigen::Lower>();
}

Eigen::Matrix3d point_block(const PointBlock& point) {
  const double* v = point.v;
  return Eigen::Matrix3d{{v[0], v[1], v[2]}, {v[1], v[3], v[4]}, {v[2], v[4], v[5]}};
}

// M^T H M, and the same without W.
template <int N>
void quadratic_forms(const Gauge& m, const SchurSystem<N>& system, Matrix7* whole, Matrix7* blocks) {
  Matrix7 cross = Matrix7::Zero();
  blocks->setZero();
  for (int i = 0; i < system.pose_count(); ++i) {
    const auto rows = m.poses.middleRows<N>(N * i);
    *blocks += rows.transpose() * pose_block(system, i) * rows;
  }
  for (int p = 0; p < system.point_count(); ++p) {
    const auto rows = m.points.middleRows<3>(3 * p);
    *blocks += rows.transpose() * point_block(system.point(p)) * rows;
    for (int s = system.point_begin(p); s < system.point_begin(p + 1); ++s) {
      Eigen::Matrix<double, N, 3> w;
      for (int c = 0; c < 3; ++c) {
        for (int r = 0; r < N; ++r) w(r, c) = system.cross(s)[cross_place<N>(r, c)];
      }
      cross += m.poses.middleRows<N>(N * system.pose_of_slot(s)).transpose() * w * rows;
    }
  }
  *whole = *blocks + cross + cross.transpose();
}

// Orthonormal with respect to `metric`, without the directions that it does not see.
Eigen::MatrixXd whitened_directions(const Matrix7& metric) {
  const Eigen::SelfAdjointEigenSolver<Matrix7> eigen(metric);
  const double largest = eigen.eigenvalues()[kMost - 1];
  Eigen::MatrixXd directions(kMost, 0);
  for (int k = 0; k < kMost; ++k) {
    const double value = eigen.eigenvalues()[k];
    if (!(value > kZero * largest)) continue;
    directions.conservativeResize(Eigen::NoChange, directions.cols() + 1);
    directions.rightCols<1>() = eigen.eigenvectors().col(k) / std::sqrt(value);
  }
  return directions;
}

}  // namespace

// A direction is free where the cost does not change along it: compared with what it would be if poses and
// points did not know of each other.
template <int N>
Gauge find_gauge(const BundleProblem& problem, const ObservationLayout& layout,
                 const SchurSystem<N>& system) {
  Gauge motions = world_motions<N>(problem, layout);
  Matrix7 whole, blocks;
  quadratic_forms(motions, system, &whole, &blocks);
  // Each motion in a unit in which it changes the cost alike.
  const Eigen::Matrix<double, kMost, 1> unit =
      blocks.diagonal().unaryExpr([](double x) { return x > 0 ? 1.0 / std::sqrt(x) : 0.0; });
  const Eigen::MatrixXd directions =
      unit.asDiagonal() * whitened_directions(unit.asDiagonal() * blocks * unit.asDiagonal());
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(
      Eigen::MatrixXd(directions.transpose() * whole * directions));
  int free = 0;
  while (free < directions.cols() && eigen.eigenvalues()[free] < kZero) ++free;
  const Eigen::MatrixXd basis = directions * eigen.eigenvectors().leftCols(free);
  return {motions.poses * basis, motions.points * basis};
}

template Gauge find_gauge<6>(const BundleProblem&, const ObservationLayout&, const SchurSystem<6>&);
template Gauge find_gauge<9>(const BundleProblem&, const ObservationLayout&, const SchurSystem<9>&);

}  // namespace raysfm
