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
                            const Velocity& velocity, const Eigen::Vector2d& pixel) {
  Eigen::Vector2f offset;
  scan_offsets(rig, 0, {&point_in_rig, 1}, velocity, {&pixel, 1}, {&offset, 1});
  return offset;
}

// A motion whose velocity at time zero is known: a screw.
Rigid3 screw(const Velocity& velocity, double time) {
  return retract(Rigid3{exp_so3({0.3, 0.2, -0.4}), {1, 2, 3}}, time * velocity);
}

Velocity some_velocity() {
  Velocity v;
  v << 0.4, -0.3, 0.2, 0.5, -0.8, 0.6;
  return v;
}

TEST(RollingShutter, VelocityIsThatOfThePolynomialThroughTheNeighbours) {
  const TimedPose here{10, screw(some_velocity(), 0)};
  std::vector<TimedPose> others;
  for (const double t : {-0.07, -0.03, 0.04}) {
    // Translation and rotation of a third degree in time, which three neighbours tell exactly.
    const Velocity moved =
        t * some_velocity() + t * t * Velocity::Constant(2) - t * t * t * Velocity::Constant(5);
    others.push_back({10 + t, retract(here.rig_from_world, moved)});
  }
  EXPECT_LT((velocity_at(here, others) - some_velocity()).norm(), 1e-9);
  others.resize(1);
  EXPECT_GT((velocity_at(here, others) - some_velocity()).norm(), 0.1);
  EXPECT_EQ(velocity_at(here, {}), Velocity::Zero());
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
  const std::vector<Eigen::Vector2d> corners = {{20, 30}, {600, 40}, {50, 440}, {610, 450}};
  for (const Eigen::Vector2d& corner : corners) {
    Ray ray;
    ASSERT_TRUE(camera.ray(corner, &ray));
    const Eigen::Vector3d in_rig = camera.rig_from_cam * (2.5 * ray.direction);
    // The pixel that sees it at the pixel's own time, by iteration to the end.
    Eigen::Vector2d seen = corner;
    for (int i = 0; i < 50; ++i) {
      const Rigid3 later = retract(Rigid3{}, 0.03 * part(seen) * some_velocity());
      ASSERT_TRUE(camera.project(cam_from_rig * (later * in_rig), &seen));
    }
    EXPECT_GT((seen - corner).norm(), 1);
    const Eigen::Vector2f offset = scan_offset(rig, in_rig, some_velocity(), seen);
    EXPECT_LT((seen - offset.cast<double>() - corner).norm(), 1e-4);
    const Eigen::Vector2f predicted = predict_scan_offset(rig, 0, in_rig, some_velocity(), corner);
    EXPECT_LT((predicted - offset).norm(), 0.01);
  }
}

INSTANTIATE_TEST_SUITE_P(Directions, ScanOffset,
                         testing::Values(RollingShutter::Direction::kDown, RollingShutter::Direction::kUp,
                                         RollingShutter::Direction::kRight,
                                         RollingShutter::Direction::kLeft));

TEST(RollingShutter, ImageVelocityIsHowFastThePixelMoves) {
  const Camera camera = scanning_camera(RollingShutter::Direction::kDown);
  const TrackingRig rig(Rig{{camera}});
  const Eigen::Vector3d in_rig = camera.rig_from_cam * Eigen::Vector3d(0.4, -0.3, 2);
  const Rigid3 cam_from_rig = camera.rig_from_cam.inverse();
  Eigen::Vector2d at, later;
  ASSERT_TRUE(camera.project(cam_from_rig * in_rig, &at));
  ASSERT_TRUE(camera.project(cam_from_rig * (retract(Rigid3{}, 1e-5 * some_velocity()) * in_rig), &later));
  const Eigen::Vector2d expected = (later - at) / 1e-5;
  EXPECT_LT((image_velocity(rig, 0, in_rig, some_velocity()) - expected).norm(), 1e-3 * expected.norm());
}

TEST(RollingShutter, NothingMovesWhereAllIsExposedAtOnce) {
  Camera camera = scanning_camera(RollingShutter::Direction::kDown);
  camera.shutter = {};
  const TrackingRig rig(Rig{{camera}});
  EXPECT_FALSE(rig.scans());
  EXPECT_EQ(scan_offset(rig, {0.2, 0.1, 3}, some_velocity(), {10, 10}), Eigen::Vector2f::Zero());
  camera.shutter.readout = 0.01;
  EXPECT_TRUE(TrackingRig(Rig{{camera}}).scans());
}

TEST(RollingShutter, PointsBehindTheCameraAreLeft) {
  const TrackingRig rig(Rig{{scanning_camera(RollingShutter::Direction::kDown)}});
  EXPECT_EQ(scan_offset(rig, {0, 0, -3}, some_velocity(), {10, 10}), Eigen::Vector2f::Zero());
  EXPECT_EQ(predict_scan_offset(rig, 0, {0, 0, -3}, some_velocity(), {320, 240}), Eigen::Vector2f::Zero());
  EXPECT_EQ(image_velocity(rig, 0, {0, 0, -3}, some_velocity()), Eigen::Vector2d::Zero());
}

}  // namespace
}  // namespace raysfm
