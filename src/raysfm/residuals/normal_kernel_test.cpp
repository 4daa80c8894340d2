#include "raysfm/residuals/normal_kernel.h"

#include <gtest/gtest.h>
#include <hwy/targets.h>

#include <Eigen/Dense>
#include <cstring>
#include <vector>

#include "raysfm/core/random.h"
#include "raysfm/geometry/pose.h"
#include "support/bundle_scene.h"

namespace raysfm {
namespace {

using RowMajor3 = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;
using Matrix26 = Eigen::Matrix<double, 2, 6>;
using Matrix23 = Eigen::Matrix<double, 2, 3>;

struct NormalFixture {
  Rigid3 pose{exp_so3({0.3, -0.2, 0.9}), {1, -2, 0.5}};
  RowMajor3 rotation = pose.rotation.toRotationMatrix();
  std::vector<Eigen::Vector3d> world;
  std::vector<Matrix23> a;
  std::vector<Eigen::Vector2d> r;
  std::vector<double> weight;
  ObservationBlock<6> block{};
  PoseSums<6> sums{};

  NormalFixture() {
    Rng rng(3);
    for (int k = 0; k < kBlockLanes; ++k) {
      world.push_back(test::random_vector(rng, 3));
      for (int c = 0; c < 3; ++c) block.x[c][k] = world[k][c];
      a.emplace_back();
      for (int c = 0; c < 6; ++c) block.jacobian[c][k] = a[k](c / 3, c % 3) = rng.normal();
      r.emplace_back(rng.normal(), rng.normal());
      block.residual[0][k] = r[k][0], block.residual[1][k] = r[k][1];
      weight.push_back(k == 5 ? 0.0 : rng.uniform());
      block.weight[k] = weight[k];
    }
    transform_points(rotation.data(), pose.translation.data(), &block);
  }

  // Derivative of A (pose * X) by the left tangent of the pose and by X, by central differences.
  Matrix26 pose_jacobian(int k) const {
    Matrix26 j;
    for (int c = 0; c < 6; ++c) {
      Eigen::Matrix<double, 6, 1> delta = Eigen::Matrix<double, 6, 1>::Zero();
      delta[c] = 1e-6;
      j.col(c) = a[k] * (retract(pose, delta) * world[k] - retract(pose, -delta) * world[k]) / 2e-6;
    }
    return j;
  }
  Matrix23 point_jacobian(int k) const {
    Matrix23 j;
    for (int c = 0; c < 3; ++c) {
      const Eigen::Vector3d delta = 1e-6 * Eigen::Vector3d::Unit(c);
      j.col(c) = a[k] * (pose * (world[k] + delta) - pose * (world[k] - delta)) / 2e-6;
    }
    return j;
  }
};

TEST(NormalKernel, IsTheNumericJacobian) {
  NormalFixture f;
  point_and_pose_terms(f.rotation.data(), &f.block, &f.sums);
  Eigen::Matrix<double, 6, 6> u = Eigen::Matrix<double, 6, 6>::Zero(), expected_u = u;
  Eigen::Matrix<double, 6, 1> gc = Eigen::Matrix<double, 6, 1>::Zero(), expected_gc = gc;
  add_pose_sums(f.sums, u.data(), gc.data());
  for (int k = 0; k < kBlockLanes; ++k) {
    EXPECT_NEAR(f.block.x[1][k], (f.pose * f.world[k]).y(), 1e-13);
    const Matrix26 jc = f.pose_jacobian(k);
    const Matrix23 jp = f.point_jacobian(k);
    expected_u += f.weight[k] * jc.transpose() * jc;
    expected_gc += f.weight[k] * jc.transpose() * f.r[k];
    const Eigen::Matrix3d v = f.weight[k] * jp.transpose() * jp;
    const Eigen::Vector3d gp = f.weight[k] * jp.transpose() * f.r[k];
    const double expected[9] = {v(0, 0), v(0, 1), v(0, 2), v(1, 1), v(1, 2), v(2, 2), gp[0], gp[1], gp[2]};
    for (int c = 0; c < 9; ++c) EXPECT_NEAR(f.block.point[c][k], expected[c], 1e-8) << c;
    const Eigen::Matrix<double, 6, 3> w = f.weight[k] * jc.transpose() * jp;
    for (int c = 0; c < 18; ++c) EXPECT_NEAR(f.block.cross[c][k], w(c % 6, c / 6), 1e-8) << c;
  }
  const Eigen::Matrix<double, 6, 6> lower = expected_u.triangularView<Eigen::Lower>();
  EXPECT_LT((u - lower).cwiseAbs().maxCoeff(), 1e-7);
  EXPECT_LT((gc - expected_gc).cwiseAbs().maxCoeff(), 1e-7);
}

TEST(NormalKernel, PointSideIsTheSameWithoutThePose) {
  NormalFixture a, b;
  point_and_pose_terms(a.rotation.data(), &a.block, &a.sums);
  point_terms(b.rotation.data(), &b.block);
  EXPECT_EQ(std::memcmp(a.block.point, b.block.point, sizeof(a.block.point)), 0);
}

TEST(NormalKernel, PoseSideIsTheSameWithoutThePoints) {
  NormalFixture a, b;
  point_and_pose_terms(a.rotation.data(), &a.block, &a.sums);
  pose_terms(b.block, &b.sums);
  EXPECT_EQ(std::memcmp(&a.sums, &b.sums, sizeof(a.sums)), 0);
}

TEST(NormalKernel, SameBitsOnEveryInstructionSet) {
  std::vector<NormalFixture> results;
  const int64_t supported = hwy::SupportedTargets();
  for (int64_t targets = supported; targets != 0; targets &= targets - 1) {
    hwy::SetSupportedTargetsForTest(targets & -targets);
    hwy::GetChosenTarget().Update(hwy::SupportedTargets());
    results.emplace_back();
    point_and_pose_terms(results.back().rotation.data(), &results.back().block, &results.back().sums);
  }
  hwy::SetSupportedTargetsForTest(0);
  hwy::GetChosenTarget().Update(hwy::SupportedTargets());
  for (const NormalFixture& f : results) {
    EXPECT_EQ(std::memcmp(&f.block, &results[0].block, sizeof(f.block)), 0);
    EXPECT_EQ(std::memcmp(&f.sums, &results[0].sums, sizeof(f.sums)), 0);
  }
}

// Nothing fixed: the frame (6) and the scale (1) are free, and no more.
TEST(NormalKernel, SevenFreeDirectionsOfTheGauge) {
  const test::BundleScene scene = test::make_bundle_scene({.poses = 6, .free_poses = 6, .points = 40});
  const int poses = 6, size = 6 * poses + 3 * 40;
  Eigen::MatrixXd h = Eigen::MatrixXd::Zero(size, size);
  for (const BundleObservation& o : scene.observations) {
    const Rigid3& pose = scene.true_poses[o.pose];
    const RowMajor3 rotation = pose.rotation.toRotationMatrix();
    const Eigen::Vector3d x = pose * scene.true_points[o.point];
    Eigen::Vector2d pixel;
    Matrix23 a;
    ASSERT_TRUE(scene.cameras[0].project(x, &pixel, &a));
    ObservationBlock<6> block{};
    for (int c = 0; c < 3; ++c) block.x[c][0] = x[c];
    for (int c = 0; c < 6; ++c) block.jacobian[c][0] = a(c / 3, c % 3);
    block.weight[0] = 1;
    PoseSums<6> sums{};
    point_and_pose_terms(rotation.data(), &block, &sums);
    Eigen::Matrix<double, 6, 6> u = Eigen::Matrix<double, 6, 6>::Zero();
    Eigen::Matrix<double, 6, 1> gradient;
    add_pose_sums(sums, u.data(), gradient.data());
    const int i = 6 * o.pose, p = 6 * poses + 3 * o.point;
    h.block<6, 6>(i, i) += Eigen::Matrix<double, 6, 6>(u.selfadjointView<Eigen::Lower>());
    for (int c = 0; c < 18; ++c) {
      h(i + c % 6, p + c / 6) += block.cross[c][0];
      h(p + c / 6, i + c % 6) += block.cross[c][0];
    }
    constexpr int kPacked[9] = {0, 1, 2, 1, 3, 4, 2, 4, 5};
    for (int c = 0; c < 9; ++c) h(p + c / 3, p + c % 3) += block.point[kPacked[c]][0];
  }
  const Eigen::VectorXd values = Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(h).eigenvalues();
  EXPECT_LT(std::abs(values[6]), 1e-11 * values[size - 1]);
  EXPECT_GT(values[7], 1e-9 * values[size - 1]);
}

}  // namespace
}  // namespace raysfm
