#include "raysfm/geometry/pose.h"

#include <gtest/gtest.h>

#include <numbers>

#include "raysfm/core/random.h"
#include "support/random_vectors.h"

namespace raysfm {
namespace {

using testing_support::normal_vector;

TEST(Rotation, ExpIsTheMatrixExponential) {
  Rng rng(1);
  for (const double scale : {0.0, 1e-10, 1e-5, 1e-3, 1.0, 2.0}) {
    const Eigen::Vector3d omega = scale * normal_vector(rng).normalized();
    Eigen::Matrix3d series = Eigen::Matrix3d::Identity(), term = Eigen::Matrix3d::Identity();
    for (int k = 1; k < 40; ++k) series += (term = term * skew(omega) / k);
    EXPECT_LT((exp_so3(omega).toRotationMatrix() - series).norm(), 1e-13) << scale;
  }
}

TEST(Rotation, LogInvertsExpUpToPi) {
  Rng rng(2);
  for (const double angle : {0.0, 1e-12, 1e-7, 1e-4, 0.5, 3.0, std::numbers::pi - 1e-9}) {
    const Eigen::Vector3d omega = angle * normal_vector(rng).normalized();
    EXPECT_LT((log_so3(exp_so3(omega)) - omega).norm(), 1e-8) << angle;
    EXPECT_NEAR(rotation_angle(exp_so3(omega)), angle, 1e-8);
  }
}

TEST(Rotation, ToZIsARotationThatDoesWhatItSays) {
  Rng rng(3);
  for (int i = 0; i < 200; ++i) {
    Eigen::Vector3d d = normal_vector(rng).normalized();
    if (i == 0) d = Eigen::Vector3d::UnitZ();
    if (i == 1) d = -Eigen::Vector3d::UnitZ();
    const Eigen::Matrix3d a = rotation_to_z(d);
    EXPECT_LT((a * d - Eigen::Vector3d::UnitZ()).norm(), 1e-14);
    EXPECT_LT((a * a.transpose() - Eigen::Matrix3d::Identity()).norm(), 1e-14);
    EXPECT_NEAR(a.determinant(), 1.0, 1e-14);
  }
}

TEST(Pose, CompositionAndInverseActOnPoints) {
  Rng rng(4);
  const Rigid3 b_from_a{exp_so3(normal_vector(rng)), normal_vector(rng)};
  const Rigid3 c_from_b{exp_so3(normal_vector(rng)), normal_vector(rng)};
  const Eigen::Vector3d x = normal_vector(rng);
  EXPECT_LT(((c_from_b * b_from_a) * x - c_from_b * (b_from_a * x)).norm(), 1e-13);
  EXPECT_LT((b_from_a.inverse() * (b_from_a * x) - x).norm(), 1e-13);
}

TEST(Pose, RetractActsOnTheLeft) {
  Rng rng(5);
  const Rigid3 b_from_a{exp_so3(normal_vector(rng)), normal_vector(rng)};
  Eigen::Matrix<double, 6, 1> delta;
  delta << normal_vector(rng), normal_vector(rng);
  const Eigen::Vector3d x = normal_vector(rng);
  const Eigen::Vector3d expected = exp_so3(delta.tail<3>()) * (b_from_a * x) + delta.head<3>();
  EXPECT_LT((retract(b_from_a, delta) * x - expected).norm(), 1e-13);
}

}  // namespace
}  // namespace raysfm
