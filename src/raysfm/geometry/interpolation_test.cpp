#include "raysfm/geometry/interpolation.h"

#include <gtest/gtest.h>

#include <numbers>

namespace raysfm {
namespace {

using Eigen::Vector3d;

// Of a camera at `centre`, turned by `angle` about its y axis.
Rigid3 cam_from_world(double angle, const Vector3d& centre) {
  return Rigid3{Eigen::Quaterniond(Eigen::AngleAxisd(angle, Vector3d::UnitY())), centre}.inverse();
}

TEST(Interpolation, GoesFromOnePoseToTheOther) {
  const Rigid3 a = cam_from_world(0.3, {1, 2, 3}), b = cam_from_world(-0.5, {-2, 0, 4});
  for (const auto& [part, expected] : {std::pair{0.0, a}, std::pair{1.0, b}}) {
    const Rigid3 pose = interpolate(a, b, part);
    EXPECT_LT(pose.rotation.angularDistance(expected.rotation), 1e-12);
    EXPECT_LT((pose.translation - expected.translation).norm(), 1e-12);
  }
}

TEST(Interpolation, CameraThatTurnsInOnePlaceStaysThere) {
  const Vector3d centre(5, -1, 20);
  const Rigid3 a = cam_from_world(0, centre), b = cam_from_world(std::numbers::pi / 2, centre);
  for (const double part : {0.25, 0.5, 0.9}) {
    const Rigid3 pose = interpolate(a, b, part);
    EXPECT_LT((pose.inverse().translation - centre).norm(), 1e-12);
    EXPECT_NEAR(pose.rotation.angularDistance(a.rotation), part * std::numbers::pi / 2, 1e-12);
  }
}

TEST(Interpolation, CentreMovesStraightWhileTheCameraTurns) {
  const Rigid3 pose = interpolate(cam_from_world(0, {0, 0, 0}), cam_from_world(2, {4, 0, 8}), 0.25);
  EXPECT_LT((pose.inverse().translation - Vector3d(1, 0, 2)).norm(), 1e-12);
}

TEST(Interpolation, GoesOnBeyondBothPoses) {
  const Rigid3 a = cam_from_world(0.1, {0, 0, 0}), b = cam_from_world(0.4, {4, 0, 8});
  for (const auto& [part, expected] : {std::pair{-1.0, cam_from_world(-0.2, {-4, 0, -8})},
                                       std::pair{2.0, cam_from_world(0.7, {8, 0, 16})}}) {
    const Rigid3 pose = interpolate(a, b, part);
    EXPECT_LT(pose.rotation.angularDistance(expected.rotation), 1e-12);
    EXPECT_LT((pose.translation - expected.translation).norm(), 1e-12);
  }
}

}  // namespace
}  // namespace raysfm
