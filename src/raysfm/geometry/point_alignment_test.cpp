#include "raysfm/geometry/point_alignment.h"

#include <gtest/gtest.h>

#include <random>

namespace raysfm {
namespace {

const Similarity3 kTrue{
    3, Eigen::Quaterniond(Eigen::AngleAxisd(1.1, Eigen::Vector3d(3, 1, 2).normalized())), {1, -2, 5}};

std::vector<Eigen::Vector3d> cloud(int count) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> in(-2, 2);
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i < count; ++i) points.push_back({in(random), in(random), in(random)});
  return points;
}

// A twentieth of the points are others, one of them a million times as far as any.
TEST(PointAlignment, IsExactWhereFewPointsAreWrong) {
  const std::vector<Eigen::Vector3d> a = cloud(200);
  std::vector<Eigen::Vector3d> b;
  for (const Eigen::Vector3d& x : a) b.push_back(kTrue * x);
  for (size_t i = 0; i < b.size(); i += 20) b[i] += Eigen::Vector3d(4, 5, 6);
  b[7] *= 1e6;
  const Similarity3 found = align_points(a, b, true);
  EXPECT_NEAR(found.scale, kTrue.scale, 1e-9);
  EXPECT_LT(found.rotation.angularDistance(kTrue.rotation), 1e-7);
  EXPECT_LT((found.translation - kTrue.translation).norm(), 1e-8);
}

TEST(PointAlignment, WithoutScaleItIsRigid) {
  const std::vector<Eigen::Vector3d> a = cloud(50);
  std::vector<Eigen::Vector3d> b;
  for (const Eigen::Vector3d& x : a) b.push_back(kTrue.rotation * x + kTrue.translation);
  EXPECT_NEAR(align_points(a, b, false).scale, 1, 1e-12);
  for (Eigen::Vector3d& x : b) x *= 1.3;
  EXPECT_NEAR(align_points(a, b, false).scale, 1, 1e-12);
  EXPECT_EQ(align_points({}, {}, true).scale, 1);
}

}  // namespace
}  // namespace raysfm
