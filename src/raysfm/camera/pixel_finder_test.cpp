#include "raysfm/camera/pixel_finder.h"

#include <gtest/gtest.h>

#include "raysfm/core/random.h"
#include "support/model_fixtures.h"

namespace raysfm {
namespace {

using testing_support::fixture_camera;
using testing_support::fixtures;

// A camera that hides that it can project.
Camera table_of(const CentralRayTable& table) {
  return fixture_camera(table);
}

// Random pixels, their rays, points on them: the finder must lead back.
void expect_found(const Camera& camera, const std::vector<double>& distances) {
  const PixelFinder finder(camera);
  Rng random(5);
  int tried = 0;
  for (int i = 0; i < 3000; ++i) {
    const Eigen::Vector2d pixel(random.uniform(-0.4, camera.width - 0.6),
                                random.uniform(-0.4, camera.height - 0.6));
    Ray ray;
    if (!camera.ray(pixel, &ray)) continue;
    for (const double distance : distances) {
      ++tried;
      const Eigen::Vector3d point = ray.origin + distance * ray.direction;
      Eigen::Vector2d found;
      ASSERT_TRUE(finder.find(point, &found)) << pixel.transpose() << " at " << distance;
      EXPECT_LT((found - pixel).norm(), 1e-6) << pixel.transpose() << " at " << distance;
    }
  }
  EXPECT_GT(tried, 500);
}

TEST(PixelFinder, LeadsBackToThePixelOfAMirror) {
  for (const Mirror& mirror : fixtures<Mirror>()) expect_found(fixture_camera(mirror), {0.2, 1, 30, 1e8});
}

TEST(PixelFinder, IsTheProjectionWhereThereIsOne) {
  const Camera camera = fixture_camera(fixtures<Radtan>()[0]);
  const PixelFinder finder(camera);
  const Eigen::Vector3d point(0.3, -0.2, 1.5);
  Eigen::Vector2d projected, found;
  Eigen::Matrix<double, 2, 3> jacobian, found_jacobian;
  ASSERT_TRUE(camera.project(point, &projected, &jacobian));
  ASSERT_TRUE(finder.find(point, &found, &found_jacobian));
  EXPECT_EQ(found, projected);
  EXPECT_EQ(found_jacobian, jacobian);
  EXPECT_FALSE(finder.find({0, 0, -1}, &found));
}

TEST(PixelFinder, JacobianAgreesWithDifferences) {
  for (const Mirror& mirror : fixtures<Mirror>()) {
    const Camera camera = fixture_camera(mirror);
    const PixelFinder finder(camera);
    Rng random(6);
    int compared = 0;
    for (int i = 0; i < 500; ++i) {
      Ray ray;
      if (!camera.ray({random.uniform(0, 639), random.uniform(0, 479)}, &ray)) continue;
      const Eigen::Vector3d point = ray.origin + random.uniform(0.3, 3) * ray.direction;
      Eigen::Vector2d pixel;
      Eigen::Matrix<double, 2, 3> jacobian;
      if (!finder.find(point, &pixel, &jacobian)) continue;
      for (int c = 0; c < 3; ++c) {
        constexpr double kStep = 1e-3;
        const Eigen::Vector3d step = kStep * Eigen::Vector3d::Unit(c);
        Eigen::Vector2d plus, minus;
        if (!finder.find(point + step, &plus) || !finder.find(point - step, &minus)) continue;
        const Eigen::Vector2d difference = (plus - minus) / (2 * kStep);
        EXPECT_LT((difference - jacobian.col(c)).norm(), 1e-3 * (1 + difference.norm()));
        ++compared;
      }
    }
    EXPECT_GT(compared, 300);
  }
}

// Whatever the point, the answer is a pixel that sees it or none.
TEST(PixelFinder, WhatItFindsSeesThePoint) {
  for (const Mirror& mirror : fixtures<Mirror>()) {
    const Camera camera = fixture_camera(mirror);
    const PixelFinder finder(camera);
    Rng random(8);
    int found = 0, lost = 0;
    for (int i = 0; i < 3000; ++i) {
      const Eigen::Vector3d point = 2 * Eigen::Vector3d(random.normal(), random.normal(), random.normal());
      Eigen::Vector2d pixel;
      if (!finder.find(point, &pixel)) {
        ++lost;
        continue;
      }
      ++found;
      Ray ray;
      ASSERT_TRUE(camera.ray(pixel, &ray));
      EXPECT_LT(ray.direction.cross((point - ray.origin).normalized()).norm(), 1e-9);
      EXPECT_GT(ray.direction.dot(point - ray.origin), 0);
    }
    EXPECT_GT(found, 300);
    EXPECT_GT(lost, 300);
  }
}

TEST(PixelFinder, RefusesPointsThatAreNone) {
  const PixelFinder finder(fixture_camera(fixtures<Mirror>()[0]));
  Eigen::Vector2d pixel;
  for (const double bad : {NAN, INFINITY, -INFINITY}) {
    EXPECT_FALSE(finder.find({bad, 0, 1}, &pixel));
    EXPECT_FALSE(finder.find({bad, bad, bad}, &pixel));
  }
  EXPECT_FALSE(finder.find({0, 0, 0}, &pixel));
  EXPECT_FALSE(PixelFinder(table_of({})).find({0, 0, 1}, &pixel));
}

}  // namespace
}  // namespace raysfm
