#include "raysfm/views/rolling_shutter.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

namespace raysfm {
namespace {

Camera scanning_camera(RollingShutter::Direction direction) {
  Camera camera;
  camera.name = "camera";
  camera.model = Pinhole{400, 400, 319.5, 239.5};
  camera.width = 640;
  camera.height = 480;
  camera.rig_from_cam = {exp_so3({0.1, -0.2, 0.05}), {0.1, 0.02, -0.03}};
  camera.shutter = {0.03, direction};
  return camera;
}

Eigen::Vector2f scan_offset(const TrackingRig& rig, const Eigen::Vector3d& point_in_rig,
                            const RigMotion& motion, const Eigen::Vector2d& pixel) {
  Eigen::Vector2f offset;
  scan_offsets(rig, 0, {&point_in_rig, 1}, motion, {&pixel, 1}, {&offset, 1});
  return offset;
}

RigMotion some_motion() {
  RigMotion motion;
  motion.velocity << 0.4, -0.3, 0.2, 0.5, -0.8, 0.6;
  motion.acceleration << -3, 4, 2, 10, 8, -9;
  return motion;
}

// The pose some time after zero, of a motion that has `jerk` besides.
TimedPose moved(double time, const RigMotion::Tangent& jerk) {
  const RigMotion motion = some_motion();
  const RigMotion::Tangent way =
      time * motion.velocity + time * time / 2 * motion.acceleration + time * time * time / 6 * jerk;
  return {10 + time, retract(Rigid3{exp_so3({0.3, 0.2, -0.4}), {1, 2, 3}}, way)};
}

TEST(RollingShutter, VelocityIsThatOfThePolynomialThroughTheNeighbours) {
  const RigMotion::Tangent jerk = RigMotion::Tangent::Constant(-30);
  const auto at = [&](std::vector<double> times) {
    std::vector<TimedPose> others;
    for (const double t : times) others.push_back(moved(t, jerk));
    return motion_at(moved(0, jerk), others).velocity;
  };
  const RigMotion::Tangent velocity = some_motion().velocity;
  EXPECT_LT((at({-0.07, -0.03, 0.04}) - velocity).norm(), 1e-9);  // three tell the third degree exactly
  EXPECT_GT((at({-0.07}) - velocity).norm(), 0.1);
  EXPECT_EQ(motion_at(moved(0, jerk), {}).velocity, RigMotion::Tangent::Zero());
}

TEST(RollingShutter, AccelerationIsThatOfTheParabolaThroughTheFarthest) {
  const auto at = [&](std::vector<double> times, double jerk) {
    std::vector<TimedPose> others;
    for (const double t : times) others.push_back(moved(t, RigMotion::Tangent::Constant(jerk)));
    return motion_at(moved(0, RigMotion::Tangent::Zero()), others).acceleration;
  };
  const RigMotion::Tangent acceleration = some_motion().acceleration;
  EXPECT_LT((at({-0.03, -0.07, 0.02, 0.04}, 0) - acceleration).norm(), 1e-9);
  // Jerk is no acceleration where the farthest are as far on either side.
  EXPECT_LT((at({-0.03, -0.06, 0.02, 0.06}, 50) - acceleration).norm(), 1e-9);
  EXPECT_GT((at({-0.03, 0.06}, 50) - acceleration).norm(), 0.1);
  EXPECT_EQ(at({-0.03, -0.06}, 0), RigMotion::Tangent::Zero());
  EXPECT_EQ(at({0.03}, 0), RigMotion::Tangent::Zero());
}

// Rows are exposed when the definition says: the point seen at a pixel is where the motion has taken the rig
// by then.
class ScanOffset : public testing::TestWithParam<RollingShutter::Direction> {};

TEST_P(ScanOffset, LeadsFromTheInstantToTheTimeOfThePixel) {
  using Direction = RollingShutter::Direction;
  const Camera camera = scanning_camera(GetParam());
  const TrackingRig rig(Rig{{camera}});
  const Rigid3 cam_from_rig = camera.rig_from_cam.inverse();
  const auto part = [&](const Eigen::Vector2d& pixel) {
    switch (GetParam()) {
      case Direction::kDown:
        return (pixel.y() + 0.5) / 480 - 0.5;
      case Direction::kUp:
        return 0.5 - (pixel.y() + 0.5) / 480;
      case Direction::kRight:
        return (pixel.x() + 0.5) / 640 - 0.5;
      case Direction::kLeft:
        return 0.5 - (pixel.x() + 0.5) / 640;
    }
    return 0.0;
  };
  const auto way_after = [](double t) {
    return RigMotion::Tangent(t * some_motion().velocity + t * t / 2 * some_motion().acceleration);
  };
  const std::vector<Eigen::Vector2d> corners = {{20, 30}, {600, 40}, {50, 440}, {610, 450}};
  for (const Eigen::Vector2d& corner : corners) {
    Ray ray;
    ASSERT_TRUE(camera.ray(corner, &ray));
    const Eigen::Vector3d in_rig = camera.rig_from_cam * (2.5 * ray.direction);
    // The pixel that sees it at the pixel's own time, by iteration to the end.
    Eigen::Vector2d seen = corner;
    for (int i = 0; i < 50; ++i) {
      const Rigid3 later = retract(Rigid3{}, way_after(0.03 * part(seen)));
      ASSERT_TRUE(camera.project(cam_from_rig * (later * in_rig), &seen));
    }
    EXPECT_GT((seen - corner).norm(), 1);
    const Eigen::Vector2f offset = scan_offset(rig, in_rig, some_motion(), seen);
    EXPECT_LT((seen - offset.cast<double>() - corner).norm(), 1e-4);
    const Eigen::Vector2f predicted = predict_scan_offset(rig, 0, in_rig, some_motion(), corner);
    EXPECT_LT((predicted - offset).norm(), 0.01);
  }
}

INSTANTIATE_TEST_SUITE_P(Directions, ScanOffset,
                         testing::Values(RollingShutter::Direction::kDown, RollingShutter::Direction::kUp,
                                         RollingShutter::Direction::kRight,
                                         RollingShutter::Direction::kLeft));

TEST(RollingShutter, ImageVelocityIsHowFastThePixelMoves) {
  constexpr double kStep = 1e-5;
  const Camera camera = scanning_camera(RollingShutter::Direction::kDown);
  const TrackingRig rig(Rig{{camera}});
  const Eigen::Vector3d in_rig = camera.rig_from_cam * Eigen::Vector3d(0.4, -0.3, 2);
  const Rigid3 cam_from_rig = camera.rig_from_cam.inverse();
  for (const double time : {0.0, 0.015}) {
    const auto seen_after = [&](double seconds) {
      Eigen::Vector2d pixel;
      const Rigid3 later = retract(Rigid3{}, some_motion().after(seconds));
      EXPECT_TRUE(camera.project(cam_from_rig * (later * in_rig), &pixel));
      return pixel;
    };
    const Eigen::Vector2d expected = (seen_after(time + kStep) - seen_after(time - kStep)) / (2 * kStep);
    const Eigen::Vector2d velocity = image_velocity(rig, 0, in_rig, some_motion(), time);
    // Off the instant, the derivative of a rotation vector is not quite the angular velocity.
    const double bound = time == 0 ? 1e-3 : 2e-3;
    EXPECT_LT((velocity - expected).norm(), bound * expected.norm()) << time;
  }
}

TEST(RollingShutter, NothingMovesWhereAllIsExposedAtOnce) {
  Camera camera = scanning_camera(RollingShutter::Direction::kDown);
  camera.shutter = {};
  const TrackingRig rig(Rig{{camera}});
  EXPECT_FALSE(rig.scans());
  EXPECT_EQ(scan_offset(rig, {0.2, 0.1, 3}, some_motion(), {10, 10}), Eigen::Vector2f::Zero());
  camera.shutter.readout = 0.01;
  EXPECT_TRUE(TrackingRig(Rig{{camera}}).scans());
}

TEST(RollingShutter, PointsBehindTheCameraAreLeft) {
  const TrackingRig rig(Rig{{scanning_camera(RollingShutter::Direction::kDown)}});
  EXPECT_EQ(scan_offset(rig, {0, 0, -3}, some_motion(), {10, 10}), Eigen::Vector2f::Zero());
  EXPECT_EQ(predict_scan_offset(rig, 0, {0, 0, -3}, some_motion(), {320, 240}), Eigen::Vector2f::Zero());
  EXPECT_EQ(image_velocity(rig, 0, {0, 0, -3}, some_motion(), 0), Eigen::Vector2d::Zero());
}

// Distortion has no measure next to the plane of the camera, where points are that are none.
TEST(RollingShutter, WhatWouldLeaveTheImageIsNotTold) {
  Camera camera = scanning_camera(RollingShutter::Direction::kDown);
  camera.model = Radtan{400, 400, 319.5, 239.5, 0.3, 0.2};
  const TrackingRig rig(Rig{{camera}});
  const Eigen::Vector3d aside = camera.rig_from_cam * Eigen::Vector3d(1, 0.3, 0.01);
  EXPECT_EQ(scan_offset(rig, aside, some_motion(), {320, 10}), Eigen::Vector2f::Zero());
  EXPECT_EQ(predict_scan_offset(rig, 0, aside, some_motion(), {320, 10}), Eigen::Vector2f::Zero());
}

}  // namespace
}  // namespace raysfm
