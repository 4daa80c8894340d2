#include "raysfm/camera/projection_inverse.h"

#include <gtest/gtest.h>

#include "raysfm/camera/observed_ray.h"

namespace raysfm {
namespace {

TEST(InvertProjection, IsTheDerivativeOfTheRay) {
  Camera camera;
  camera.model = Radtan{420, 430, 310, 250, -0.2, 0.05, 1e-3, -5e-4, 0};
  for (const Eigen::Vector2d& pixel : {Eigen::Vector2d(20, 30), {310, 250}, {600, 400}, {100, 450}}) {
    Ray ray;
    ASSERT_TRUE(camera.ray(pixel, &ray));
    Eigen::Matrix<double, 3, 2> inverse, differences;
    ASSERT_TRUE(invert_projection(camera, ray, &inverse));
    ASSERT_TRUE(ray_jacobian(camera, pixel, &differences));
    EXPECT_LT((inverse - differences).norm(), 1e-5 * differences.norm());
  }
}

TEST(InvertProjection, RefusesRaysThatPassBesideTheOrigin) {
  Camera camera;
  camera.model = Radtan{420, 430, 310, 250, -0.2, 0.05, 1e-3, -5e-4, 0};
  Eigen::Matrix<double, 3, 2> jacobian;
  EXPECT_TRUE(invert_projection(camera, {{0, 0, 0}, {0, 0, 1}}, &jacobian));
  EXPECT_FALSE(invert_projection(camera, {{0.1, 0, 0}, {0, 0, 1}}, &jacobian));
}

}  // namespace
}  // namespace raysfm
