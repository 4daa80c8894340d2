#include "raysfm/eval/trajectory_error.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "raysfm/core/random.h"

namespace raysfm {
namespace {

// A drive over hills on a circle of 50 m radius, in a world whose y axis points down.
Trajectory circle(int count) {
  Trajectory trajectory;
  for (int i = 0; i < count; ++i) {
    const double angle = 2 * std::numbers::pi * i / count;
    trajectory.timestamps.push_back(0.1 * i);
    trajectory.world_from_cam.push_back(
        {exp_so3({0, angle, 0}), {50 * std::cos(angle), -0.5 * std::sin(3 * angle), 50 * std::sin(angle)}});
  }
  return trajectory;
}

Trajectory transformed(const Similarity3& transform, Trajectory trajectory) {
  for (Rigid3& pose : trajectory.world_from_cam) pose = transform_pose(transform, pose);
  return trajectory;
}

const Similarity3 kOther{0.2, exp_so3({2, 1, -0.5}), {1, 2, 3}};

Evaluation evaluate_ok(const Trajectory& estimate, const Trajectory& truth, Alignment alignment) {
  const Result<Evaluation> result = evaluate(estimate, truth, {alignment, 0.01});
  if (!result) ADD_FAILURE() << result.error().message;
  return result ? *result : Evaluation{};
}

TEST(ErrorStatistics, OfKnownNumbers) {
  const ErrorStatistics odd = error_statistics({3, 1, 2});
  EXPECT_DOUBLE_EQ(odd.mean, 2);
  EXPECT_DOUBLE_EQ(odd.median, 2);
  EXPECT_DOUBLE_EQ(odd.max, 3);
  EXPECT_DOUBLE_EQ(odd.rmse, std::sqrt(14.0 / 3));
  EXPECT_DOUBLE_EQ(error_statistics({4, 1, 2, 3}).median, 2.5);
}

TEST(Evaluate, SimilarityIsNoError) {
  const Trajectory truth = circle(100);
  const Evaluation e = evaluate_ok(transformed(kOther, truth), truth, Alignment::kSim3);
  EXPECT_LT(e.ate.max, 1e-10);
  EXPECT_LT(e.rpe.trans, 1e-10);
  EXPECT_LT(e.rpe.rot_deg, 1e-6);
  EXPECT_NEAR(e.truth_from_estimate.scale, 5.0, 1e-12);
  EXPECT_EQ(e.coverage, 1.0);
}

TEST(Evaluate, RigidSeesAnErrorOfScale) {
  const Trajectory truth = circle(100);
  const Evaluation e =
      evaluate_ok(transformed({1.01, kOther.rotation, kOther.translation}, truth), truth, Alignment::kSe3);
  // Every pose is 1 % of its distance to the centre away.
  EXPECT_NEAR(e.ate.mean, 0.5, 0.001);
}

TEST(Evaluate, NoneSeesAnOffset) {
  const Trajectory truth = circle(100);
  const Evaluation e = evaluate_ok(transformed({1, Eigen::Quaterniond::Identity(), {3, 4, 0}}, truth), truth,
                                   Alignment::kNone);
  EXPECT_NEAR(e.ate.mean, 5, 1e-12);
  EXPECT_NEAR(e.ate.rmse, 5, 1e-12);
  EXPECT_LT(e.rpe.trans, 1e-12);
}

TEST(Evaluate, NoiseOfKnownSize) {
  const Trajectory truth = circle(4000);
  Trajectory estimate = truth;
  Rng rng(7);
  const double sigma = 0.1;
  for (Rigid3& pose : estimate.world_from_cam) {
    pose.translation += sigma * Eigen::Vector3d(rng.normal(), rng.normal(), rng.normal());
  }
  const Evaluation e = evaluate_ok(transformed(kOther, estimate), truth, Alignment::kSim3);
  EXPECT_NEAR(e.ate.rmse, sigma * std::sqrt(3.0), 0.003);
  // Means of the Maxwell and the Rayleigh distribution.
  EXPECT_NEAR(e.ate.mean, sigma * std::sqrt(8 / std::numbers::pi), 0.003);
  EXPECT_NEAR(e.ate_horizontal.mean, sigma * std::sqrt(std::numbers::pi / 2), 0.003);
  EXPECT_NEAR(e.rpe.trans, sigma * std::sqrt(6.0), 0.005);
}

TEST(Evaluate, HorizontalErrorLeavesOutTheAltitude) {
  const Trajectory truth = circle(100);
  Trajectory estimate = truth;
  for (int i = 0; i < estimate.size(); ++i) {
    estimate.world_from_cam[i].translation.y() += i % 2 == 0 ? 1 : -1;
  }
  for (const Similarity3& world : {Similarity3{}, Similarity3{1, kOther.rotation, kOther.translation}}) {
    const Evaluation e =
        evaluate_ok(transformed(world, estimate), transformed(world, truth), Alignment::kNone);
    EXPECT_NEAR(e.ate.mean, 1, 1e-9);
    EXPECT_LT(e.ate_horizontal.mean, 0.02);
  }
}

TEST(Evaluate, DrawingPlaneIsSeenFromAbove) {
  // Forward is z, then a turn to the right, towards x: on a map the turn must be clockwise.
  Trajectory truth;
  for (int i = 0; i < 20; ++i) {
    truth.timestamps.push_back(i);
    const double z = std::min(i, 12), x = std::max(i - 12, 0);
    truth.world_from_cam.push_back({Eigen::Quaterniond::Identity(), {x, 0.1 * (i % 2), z}});
  }
  const Evaluation e = evaluate_ok(truth, truth, Alignment::kNone);
  const Eigen::Vector2d ahead = e.plane_from_world * Eigen::Vector3d::UnitZ();
  const Eigen::Vector2d right = e.plane_from_world * Eigen::Vector3d::UnitX();
  EXPECT_LT(ahead.x() * right.y() - ahead.y() * right.x(), -0.99);
  EXPECT_GT(ahead.x(), 0.5);
}

TEST(Evaluate, RelativeRotationOfKnownSize) {
  const Trajectory truth = circle(50);
  Trajectory estimate = truth;
  for (int i = 1; i < estimate.size(); i += 2) {
    estimate.world_from_cam[i].rotation *= exp_so3({0, 0, 0.02});
  }
  const Evaluation e = evaluate_ok(estimate, truth, Alignment::kNone);
  EXPECT_NEAR(e.rpe.rot_deg, 0.02 * 180 / std::numbers::pi, 1e-9);
}

TEST(Evaluate, CoverageAndLengthOfPartOfThePath) {
  Trajectory truth;
  for (int i = 0; i < 10; ++i) {
    truth.timestamps.push_back(i);
    truth.world_from_cam.push_back({Eigen::Quaterniond::Identity(), {2.0 * i, 0, 0}});
  }
  Trajectory estimate;
  for (const int i : {2, 3, 7}) {
    estimate.timestamps.push_back(truth.timestamps[i]);
    estimate.world_from_cam.push_back(truth.world_from_cam[i]);
  }
  const Evaluation e = evaluate_ok(estimate, truth, Alignment::kSe3);
  EXPECT_DOUBLE_EQ(e.coverage, 0.3);
  EXPECT_DOUBLE_EQ(e.length, 10);
  EXPECT_FALSE(e.kitti.has_value());
}

TEST(Evaluate, TooFewMatchesSayWhatThereIs) {
  const Trajectory truth = circle(10);
  Trajectory estimate = truth;
  for (double& t : estimate.timestamps) t += 1000;
  const Result<Evaluation> result = evaluate(estimate, truth, {});
  ASSERT_FALSE(result.ok());
  EXPECT_EQ(result.error().kind, ErrorKind::kBadInput);
  EXPECT_NE(result.error().message.find("0 poses of the estimate match"), std::string::npos);
  EXPECT_NE(result.error().message.find("from 1000.0"), std::string::npos);
  EXPECT_FALSE(evaluate(estimate, Trajectory{}, {}).ok());
}

// A straight drive of 1 km at 1 m a frame.
Trajectory straight(double scale, double yaw_per_metre) {
  Trajectory trajectory;
  Rigid3 pose;
  const Rigid3 step{exp_so3({0, yaw_per_metre, 0}), {0, 0, scale}};
  for (int i = 0; i <= 1000; ++i) {
    trajectory.timestamps.push_back(i);
    trajectory.world_from_cam.push_back(pose);
    pose = pose * step;
  }
  return trajectory;
}

TEST(KittiDrift, ErrorOfScaleIsItsPercentage) {
  const Evaluation e = evaluate_ok(straight(1.02, 0), straight(1, 0), Alignment::kNone);
  ASSERT_TRUE(e.kitti);
  // A stretch ends at the first pose beyond its length, here up to a metre late.
  EXPECT_NEAR(e.kitti->t_rel_percent, 2.0, 0.02);
  EXPECT_NEAR(e.kitti->r_rel_deg_per_100m, 0, 1e-6);
}

TEST(KittiDrift, ConstantTurnIsItsRate) {
  const double radians_per_metre = 0.5 / 100 * std::numbers::pi / 180;
  const Evaluation e = evaluate_ok(straight(1, radians_per_metre), straight(1, 0), Alignment::kNone);
  ASSERT_TRUE(e.kitti);
  EXPECT_NEAR(e.kitti->r_rel_deg_per_100m, 0.5, 0.005);
}

TEST(KittiDrift, CountsStretchesEveryTenthPose) {
  const Evaluation e = evaluate_ok(straight(1, 0), straight(1, 0), Alignment::kNone);
  // Starts 0, 10, ..., with first + length < 1000, as a stretch must end beyond its length.
  EXPECT_EQ(e.kitti->stretches, 90 + 80 + 70 + 60 + 50 + 40 + 30 + 20);
}

}  // namespace
}  // namespace raysfm
