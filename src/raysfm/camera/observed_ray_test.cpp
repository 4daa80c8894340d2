#include "raysfm/camera/observed_ray.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>

namespace raysfm {
namespace {

Camera tilted_camera() {
  Camera camera;
  camera.model = Radtan{420, 430, 310, 250, -0.2, 0.05, 1e-3, -5e-4, 0};
  camera.width = 640;
  camera.height = 480;
  camera.rig_from_cam.rotation = Eigen::AngleAxisd(0.7, Eigen::Vector3d(1, -2, 0.5).normalized());
  camera.rig_from_cam.translation = {0.3, -0.1, 0.2};
  return camera;
}

TEST(ObservedRay, LengthIsTheTangentOfTheAngle) {
  const Camera camera = tilted_camera();
  ObservedRay ray;
  ASSERT_TRUE(observe_ray(camera, {500, 100}, AngularWeight::kNone, &ray));
  const Eigen::Vector3d point(0.8, 1.1, 4.0);
  const Eigen::Vector3d d = (point - camera.rig_from_cam.translation).normalized();
  Eigen::Vector2d r;
  ASSERT_TRUE(ray.residual(point, &r));
  EXPECT_NEAR(r.norm(), std::tan(std::acos(d.dot(ray.direction))), 1e-12);
}

TEST(ObservedRay, WhitenedIsThePixelErrorToFirstOrder) {
  const Camera camera = tilted_camera();
  const Eigen::Vector2d observed(520, 90);
  ObservedRay ray;
  ASSERT_TRUE(observe_ray(camera, observed, AngularWeight::kPixel, &ray));
  for (const Eigen::Vector2d& error : {Eigen::Vector2d(0.3, 0), Eigen::Vector2d(-0.1, 0.25)}) {
    Ray seen;
    ASSERT_TRUE(camera.ray(observed + error, &seen));
    Eigen::Vector2d r;
    ASSERT_TRUE(ray.residual(camera.rig_from_cam * Eigen::Vector3d(5 * seen.direction), &r));
    EXPECT_LT((r - error).norm(), 2e-3 * error.norm());
  }
}

Camera sphere_mirror() {
  Camera camera;
  camera.model = Mirror::from_parameters(
      {1640, 1640, 319.5, 319.5, 0.1, 0, 0.083, 0.0025, -0.0015, 0.4, 0, 0, 0, 1, 0.022});
  camera.width = camera.height = 640;
  return camera;
}

// Errors in all directions of the image, at any distance. The two caustics of a sphere are apart, so that
// errors along a radius come out too large and those across it too small; their squares make up for each
// other.
TEST(ObservedRay, WhitenedIsThePixelErrorOfAMirrorAtAnyDistance) {
  constexpr int kDirections = 16;
  constexpr double kError = 0.05;
  const Camera camera = sphere_mirror();
  for (const Eigen::Vector2d& observed : {Eigen::Vector2d(400, 330), Eigen::Vector2d(200, 500)}) {
    ObservedRay ray;
    ASSERT_TRUE(observe_ray(camera, observed, AngularWeight::kPixel, &ray));
    for (const double distance : {0.4, 2.0, 10.0}) {
      double squares = 0;
      for (int i = 0; i < kDirections; ++i) {
        const double angle = 2 * std::numbers::pi * i / kDirections;
        Ray seen;
        ASSERT_TRUE(camera.ray(observed + kError * Eigen::Vector2d(std::cos(angle), std::sin(angle)), &seen));
        Eigen::Vector2d r;
        ASSERT_TRUE(ray.residual(seen.origin + distance * seen.direction, &r));
        squares += r.squaredNorm() / kDirections;
      }
      EXPECT_NEAR(squares / (kError * kError), 1, 0.01) << distance;
    }
  }
}

TEST(ObservedRay, JacobianAgreesWithDifferences) {
  ObservedRay ray;
  ASSERT_TRUE(observe_ray(tilted_camera(), {200, 300}, AngularWeight::kPixel, &ray));
  const Eigen::Vector3d point = ray.origin + 3 * ray.direction + Eigen::Vector3d(0.1, 0.2, -0.1);
  Eigen::Vector2d r, plus, minus;
  Eigen::Matrix<double, 2, 3> jacobian;
  ASSERT_TRUE(ray.residual(point, &r, &jacobian));
  for (int c = 0; c < 3; ++c) {
    const Eigen::Vector3d step = 1e-6 * Eigen::Vector3d::Unit(c);
    ASSERT_TRUE(ray.residual(point + step, &plus));
    ASSERT_TRUE(ray.residual(point - step, &minus));
    EXPECT_LT(((plus - minus) / 2e-6 - jacobian.col(c)).norm(), 1e-5);
  }
}

TEST(ObservedRay, NothingBehindTheRay) {
  ObservedRay ray;
  ASSERT_TRUE(observe_ray(tilted_camera(), {200, 300}, AngularWeight::kNone, &ray));
  Eigen::Vector2d r;
  EXPECT_FALSE(ray.residual(ray.origin - ray.direction, &r));
  EXPECT_FALSE(ray.residual(ray.origin, &r));
}

}  // namespace
}  // namespace raysfm
