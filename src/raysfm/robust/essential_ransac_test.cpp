#include "raysfm/robust/essential_ransac.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

#include "raysfm/core/random.h"
#include "raysfm/geometry/pose.h"
#include "raysfm/geometry/rotation.h"
#include "raysfm/solvers/five_point.h"

namespace raysfm {
namespace {

// Points all round two cameras that look about, with noise of a milliradian.
struct TwoSpheres {
  explicit TwoSpheres(double wrong) {
    Rng rng(5);
    for (int i = 0; i < 400; ++i) {
      const auto any = [&] { return Eigen::Vector3d(rng.normal(), rng.normal(), rng.normal()); };
      const Eigen::Vector3d point = rng.uniform(2, 6) * any().normalized();
      is_wrong.push_back(rng.uniform() < wrong);
      bearings0.push_back((point.normalized() + 1e-3 * any()).normalized());
      bearings1.push_back(is_wrong.back()
                              ? any().normalized()
                              : ((cam1_from_cam0 * point).normalized() + 1e-3 * any()).normalized());
    }
  }

  Rigid3 cam1_from_cam0{exp_so3(Eigen::Vector3d(0.3, -0.5, 0.2)), Eigen::Vector3d(0.8, 0.1, -0.3)};
  std::vector<Eigen::Vector3d> bearings0, bearings1;
  std::vector<uint8_t> is_wrong;
};

TEST(EssentialRansac, TellsTheMotionThoughHalfOfTheMatchesAreWrong) {
  const TwoSpheres two(0.5);
  EssentialRansac estimator(two.bearings0, two.bearings1, 4e-3);
  Eigen::Matrix3d essential;
  ASSERT_TRUE(ransac(estimator, {}, &essential).found());
  Rigid3 found;
  choose_pose(essential, two.bearings0, two.bearings1, &found);
  EXPECT_LT(found.rotation.angularDistance(two.cam1_from_cam0.rotation), 2e-3);
  EXPECT_GT(found.translation.normalized().dot(two.cam1_from_cam0.translation.normalized()), std::cos(0.01));
  int right = 0, wrong = 0;
  for (int i = 0; i < estimator.size(); ++i)
    (two.is_wrong[i] ? wrong : right) += estimator.is_inlier(essential, i);
  EXPECT_GT(right, 0.95 * static_cast<double>(std::ranges::count(two.is_wrong, 0)));
  EXPECT_LT(wrong, 10);  // those that lie on their planes by chance
}

// The bearings that an error of so many radians across the epipolar plane leaves.
TEST(EssentialRansac, ErrorsAreAngles) {
  const TwoSpheres two(0);
  const Eigen::Matrix3d essential =
      skew(two.cam1_from_cam0.translation) * two.cam1_from_cam0.rotation.toRotationMatrix();
  constexpr double kError = 2e-3;
  for (int i = 0; i < 50; ++i) {
    const Eigen::Vector3d point = 3 * two.bearings0[i], in_1 = (two.cam1_from_cam0 * point).normalized();
    const Eigen::Vector3d across = (essential * two.bearings0[i]).normalized();
    const std::vector<Eigen::Vector3d> a = {two.bearings0[i]}, b = {(in_1 + kError * across).normalized()};
    const auto agrees = [&](double max_error) {
      return EssentialRansac(a, b, max_error).is_inlier(essential, 0);
    };
    EXPECT_FALSE(agrees(0.2 * kError)) << "both bearings share the error";
    EXPECT_TRUE(agrees(1.01 * kError));
  }
}

}  // namespace
}  // namespace raysfm
