#include "raysfm/robust/three_view_kernel.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <limits>
#include <vector>

#include "raysfm/geometry/ray.h"
#include "raysfm/geometry/rotation.h"

namespace raysfm {
namespace {

using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr int kPoints = 11;  // not a multiple of what is done at once
constexpr int kUnknowns = kPoseNumbers + 3 * kPoints;
constexpr double kDamping = 0.3;

// Points seen by three views a little beside where they are; residuals written down plainly.
struct KernelScene {
  std::array<Matrix3d, 3> rotations;
  std::array<Vector3d, 3> translations;
  std::array<std::array<Vector3d, kPoints>, 3> bearings;
  Eigen::Matrix<double, 2, 3> baseline_tangents;
  std::array<Vector3d, kPoints> places;  // along two tangents, inverse distance

  KernelScene() {
    rotations = {Matrix3d::Identity(), exp_so3({0.1, -0.2, 0.05}).toRotationMatrix(),
                 exp_so3({-0.05, 0.3, 0.1}).toRotationMatrix()};
    translations = {Vector3d::Zero(), {0.4, 0.1, -0.2}, Vector3d(0.8, -0.3, 0.5).normalized()};
    baseline_tangents = tangent_rows(translations[2]);
    for (int i = 0; i < kPoints; ++i) {
      places[i] = {0.01 * ((3 * i) % 7 - 3), 0.01 * ((5 * i) % 7 - 3), i == 0 ? 0.0 : 0.04 * i};
      const Vector3d point(0.3 * ((2 * i) % 5 - 2), 0.2 * ((3 * i) % 5 - 2), 2);
      for (int v = 0; v < 3; ++v) {
        const Vector3d noise = 0.01 * Vector3d((i + v) % 3 - 1, (2 * i + v) % 3 - 1, 0);
        bearings[v][i] =
            (rotations[v] * point.normalized() + places[i][2] * translations[v] + noise).normalized();
      }
    }
  }

  // All six of each point, at a step of all unknowns.
  VectorXd residuals(const VectorXd& step) const {
    VectorXd r(6 * kPoints);
    std::array<Matrix3d, 3> moved_rotations = rotations;
    std::array<Vector3d, 3> moved_translations = translations;
    moved_rotations[1] = exp_so3(step.segment<3>(3)).toRotationMatrix() * rotations[1];
    moved_translations[1] = exp_so3(step.segment<3>(3)).toRotationMatrix() * translations[1] + step.head<3>();
    moved_rotations[2] = exp_so3(step.segment<3>(8)).toRotationMatrix() * rotations[2];
    moved_translations[2] = exp_so3(step.segment<3>(8)).toRotationMatrix() * translations[2] +
                            baseline_tangents.transpose() * step.segment<2>(6);
    for (int i = 0; i < kPoints; ++i) {
      const Vector3d place = places[i] + step.segment<3>(kPoseNumbers + 3 * i);
      const Vector3d direction = bearings[0][i] + tangent_rows(bearings[0][i]).transpose() * place.head<2>();
      for (int v = 0; v < 3; ++v) {
        const Vector3d seen = moved_rotations[v] * direction + place[2] * moved_translations[v];
        r.segment<2>(6 * i + 2 * v) = tangent_rows(bearings[v][i]) * seen / bearings[v][i].dot(seen);
      }
    }
    return r;
  }

  ThreeViewPoses poses() const {
    ThreeViewPoses p;
    for (int v = 1; v < 3; ++v) {
      Eigen::Map<Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(p.rotations[v - 1].data()) = rotations[v];
      Eigen::Map<Vector3d>(p.translations[v - 1].data()) = translations[v];
    }
    for (int row = 0; row < 2; ++row)
      Eigen::Map<Vector3d>(p.baseline_tangents[row].data()) = baseline_tangents.row(row);
    return p;
  }

  std::vector<ThreeViewPoints> points() const {
    std::vector<ThreeViewPoints> groups((kPoints + kPointLanes - 1) / kPointLanes);
    for (int k = 0; k < static_cast<int>(groups.size()) * kPointLanes; ++k) {
      ThreeViewPoints& group = groups[k / kPointLanes];
      const int lane = k % kPointLanes, i = k < kPoints ? k : 0;
      for (int c = 0; c < 3; ++c) {
        group.place[c][lane] = places[i][c];
        for (int v = 0; v < 3; ++v) {
          group.bearings[v][c][lane] = bearings[v][i][c];
          for (int row = 0; row < 2; ++row)
            group.tangents[v][row][c][lane] = k < kPoints ? tangent_rows(bearings[v][i])(row, c) : 0;
        }
      }
    }
    return groups;
  }
};

// Gauss-Newton's equations of all unknowns, derivatives by differences.
struct DenseEquations {
  MatrixXd hessian;
  VectorXd gradient;

  explicit DenseEquations(const KernelScene& scene) {
    constexpr double kStep = 1e-6;
    MatrixXd jacobian(6 * kPoints, kUnknowns);
    for (int j = 0; j < kUnknowns; ++j) {
      const VectorXd step = kStep * VectorXd::Unit(kUnknowns, j);
      jacobian.col(j) = (scene.residuals(step) - scene.residuals(-step)) / (2 * kStep);
    }
    hessian = jacobian.transpose() * jacobian;
    gradient = jacobian.transpose() * scene.residuals(VectorXd::Zero(kUnknowns));
    hessian.diagonal() *= 1 + kDamping;
  }
};

TEST(ThreeViewKernel, SumsAreTheEquationsWithPointsEliminated) {
  const KernelScene scene;
  std::vector<ThreeViewPoints> points = scene.points();
  ThreeViewSums sums;
  linearise_three_views(scene.poses(), kDamping, points.data(), static_cast<int>(points.size()), &sums);

  const DenseEquations dense(scene);
  const int n = kPoseNumbers, m = 3 * kPoints;
  const MatrixXd eliminated = dense.hessian.topRightCorner(n, m) *
                              dense.hessian.bottomRightCorner(m, m).ldlt().solve(MatrixXd::Identity(m, m));
  const MatrixXd hessian =
      dense.hessian.topLeftCorner(n, n) - eliminated * dense.hessian.bottomLeftCorner(m, n);
  const VectorXd gradient = dense.gradient.head(n) - eliminated * dense.gradient.tail(m);
  int at = 0;
  for (int i = 0; i < n; ++i) {
    EXPECT_NEAR(sums.gradient[i], gradient[i], 1e-6);
    for (int j = i; j < n; ++j) EXPECT_NEAR(sums.hessian[at++], hessian(i, j), 1e-6);
  }
}

TEST(ThreeViewKernel, PointsFollowAStepAsTheEquationsSay) {
  const KernelScene scene;
  std::vector<ThreeViewPoints> points = scene.points();
  const int groups = static_cast<int>(points.size());
  ThreeViewSums sums;
  linearise_three_views(scene.poses(), kDamping, points.data(), groups, &sums);
  const DenseEquations dense(scene);
  const VectorXd all = dense.hessian.ldlt().solve(-dense.gradient);
  std::array<double, kPoseNumbers> step;
  for (int i = 0; i < kPoseNumbers; ++i) step[i] = all[i];
  move_three_view_points(step, points.data(), groups);
  for (int i = 0; i < kPoints; ++i) {
    for (int c = 0; c < 3; ++c) {
      EXPECT_NEAR(points[i / kPointLanes].moved[c][i % kPointLanes],
                  scene.places[i][c] + all[kPoseNumbers + 3 * i + c], 1e-5);
    }
  }
}

TEST(ThreeViewKernel, CostIsTheSumOfSquaresAndInfiniteBehindAView) {
  const KernelScene scene;
  std::vector<ThreeViewPoints> points = scene.points();
  const int groups = static_cast<int>(points.size());
  EXPECT_NEAR(three_view_cost(scene.poses(), points.data(), groups, false),
              scene.residuals(VectorXd::Zero(kUnknowns)).squaredNorm(), 1e-12);
  for (ThreeViewPoints& group : points) std::copy_n(&group.place[0][0], 3 * kPointLanes, &group.moved[0][0]);
  points[1].moved[2][1] = 50;  // so near that views 1 and 2 look past it
  EXPECT_EQ(three_view_cost(scene.poses(), points.data(), groups, true),
            std::numeric_limits<double>::infinity());
}

}  // namespace
}  // namespace raysfm
