#include "raysfm/camera/observed_ray.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>

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
