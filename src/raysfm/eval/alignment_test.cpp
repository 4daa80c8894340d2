#include "raysfm/eval/alignment.h"

#include <gtest/gtest.h>

#include "raysfm/core/random.h"

namespace raysfm {
namespace {

const Similarity3 kTruthFromEstimate{2.5, exp_so3({0.4, -1.1, 2.0}), {3, -7, 11}};

Eigen::Matrix3Xd random_points(int count, uint64_t seed) {
  Rng rng(seed);
  Eigen::Matrix3Xd points(3, count);
  for (double& x : points.reshaped()) x = rng.normal();
  return points;
}

Eigen::Matrix3Xd apply(const Similarity3& transform, const Eigen::Matrix3Xd& points) {
  Eigen::Matrix3Xd result = points;
  for (Eigen::Index i = 0; i < points.cols(); ++i) result.col(i) = transform * Eigen::Vector3d(points.col(i));
  return result;
}

double squared_error(const Similarity3& transform, const Eigen::Matrix3Xd& from, const Eigen::Matrix3Xd& to) {
  return (apply(transform, from) - to).squaredNorm();
}

TEST(Alignment, FindsAKnownSimilarity) {
  const Eigen::Matrix3Xd estimate = random_points(20, 1);
  const Eigen::Matrix3Xd truth = apply(kTruthFromEstimate, estimate);
  const Similarity3 found = align_points(estimate, truth, Alignment::kSim3);
  EXPECT_NEAR(found.scale, 2.5, 1e-12);
  EXPECT_LT(rotation_angle(found.rotation * kTruthFromEstimate.rotation.conjugate()), 1e-12);
  EXPECT_LT((found.translation - kTruthFromEstimate.translation).norm(), 1e-12);
}

TEST(Alignment, RigidLeavesTheScaleAlone) {
  const Eigen::Matrix3Xd estimate = random_points(20, 2);
  const Similarity3 found = align_points(estimate, apply(kTruthFromEstimate, estimate), Alignment::kSe3);
  EXPECT_EQ(found.scale, 1.0);
  EXPECT_LT(rotation_angle(found.rotation * kTruthFromEstimate.rotation.conjugate()), 1e-12);
}

TEST(Alignment, NoneIsTheIdentity) {
  const Eigen::Matrix3Xd estimate = random_points(20, 2);
  const Similarity3 found = align_points(estimate, apply(kTruthFromEstimate, estimate), Alignment::kNone);
  EXPECT_EQ(squared_error(found, estimate, estimate), 0.0);
}

// The definition of a minimum: no small step away from it lowers the sum of squares.
TEST(Alignment, IsTheLeastSquaresMinimumUnderNoise) {
  const Eigen::Matrix3Xd estimate = random_points(30, 3);
  const Eigen::Matrix3Xd truth = apply(kTruthFromEstimate, estimate) + 0.3 * random_points(30, 4);
  const Similarity3 found = align_points(estimate, truth, Alignment::kSim3);
  const double minimum = squared_error(found, estimate, truth);
  for (const double step : {-1e-3, 1e-3}) {
    Similarity3 moved = found;
    moved.scale += step;
    EXPECT_GT(squared_error(moved, estimate, truth), minimum);
    for (int axis = 0; axis < 3; ++axis) {
      moved = found;
      moved.translation[axis] += step;
      EXPECT_GT(squared_error(moved, estimate, truth), minimum);
      moved = found;
      moved.rotation = exp_so3(step * Eigen::Vector3d::Unit(axis)) * found.rotation;
      EXPECT_GT(squared_error(moved, estimate, truth), minimum);
    }
  }
}

TEST(Alignment, NeverReflects) {
  const Eigen::Matrix3Xd estimate = random_points(20, 5);
  Eigen::Matrix3Xd mirrored = estimate;
  mirrored.row(2) *= -1;
  const Similarity3 found = align_points(estimate, mirrored, Alignment::kSim3);
  EXPECT_NEAR(found.rotation.norm(), 1.0, 1e-12);
  EXPECT_GT(squared_error(found, estimate, mirrored), 1.0);
}

TEST(Alignment, StraightLineFitsExactly) {
  Eigen::Matrix3Xd estimate = Eigen::Matrix3Xd::Zero(3, 10);
  for (int i = 0; i < 10; ++i) estimate.col(i) = i * Eigen::Vector3d(1, 2, 3);
  const Eigen::Matrix3Xd truth = apply(kTruthFromEstimate, estimate);
  const Similarity3 found = align_points(estimate, truth, Alignment::kSim3);
  EXPECT_LT(squared_error(found, estimate, truth), 1e-18);
}

TEST(Alignment, PointsThatCoincideGiveATranslation) {
  const Eigen::Matrix3Xd estimate = Eigen::Vector3d(1, 2, 3).replicate(1, 5);
  const Eigen::Matrix3Xd truth = random_points(5, 6);
  const Similarity3 found = align_points(estimate, truth, Alignment::kSim3);
  EXPECT_EQ(found.scale, 1.0);
  EXPECT_LT((found * Eigen::Vector3d(1, 2, 3) - truth.rowwise().mean()).norm(), 1e-12);
}

TEST(Alignment, TruthThatStandsStillStaysFinite) {
  const Eigen::Matrix3Xd truth = Eigen::Vector3d(1, 2, 3).replicate(1, 5);
  const Similarity3 found = align_points(random_points(5, 7), truth, Alignment::kSim3);
  EXPECT_NEAR(found.scale, 0.0, 1e-12);
  EXPECT_TRUE(found.rotation.coeffs().allFinite() && found.translation.allFinite());
}

TEST(Alignment, MovesPosesAsItMovesPoints) {
  const Rigid3 estimate_from_cam{exp_so3({1, 2, 0.5}), {4, 5, 6}};
  const Rigid3 moved = transform_pose(kTruthFromEstimate, estimate_from_cam);
  // A point one unit before the camera is, in a world scaled by s, s units before it.
  const Eigen::Vector3d ahead(0, 0, 1);
  const Eigen::Vector3d expected = kTruthFromEstimate * (estimate_from_cam * ahead);
  EXPECT_LT((moved * (kTruthFromEstimate.scale * ahead) - expected).norm(), 1e-12);
}

}  // namespace
}  // namespace raysfm
