#include "raysfm/geometry/triangulation.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <limits>
#include <numbers>
#include <vector>

#include "raysfm/core/random.h"
#include "raysfm/geometry/rotation.h"
#include "support/random_vectors.h"

namespace raysfm {
namespace {

using testing_support::normal_vector;

using Eigen::Vector3d;

// Rays from origins near `centre` to `point`, their directions turned by noise * N(0, 1) radians per axis.
std::vector<Ray> rays_to(const Vector3d& point, const Vector3d& centre, int count, double noise, Rng& rng) {
  std::vector<Ray> rays(count);
  for (Ray& ray : rays) {
    ray.origin = centre + normal_vector(rng);
    ray.direction = exp_so3(noise * normal_vector(rng)) * (point - ray.origin).normalized();
  }
  return rays;
}

double sum_of_squared_tangents(const std::vector<Ray>& rays, const Vector3d& point) {
  double sum = 0;
  for (const Ray& ray : rays) {
    const Vector3d d = point - ray.origin;
    const double tangent = ray.direction.cross(d).norm() / ray.direction.dot(d);
    sum += tangent * tangent;
  }
  return sum;
}

TEST(Triangulation, ExactRaysGiveThePoint) {
  Rng rng(1);
  for (int i = 0; i < 2000; ++i) {
    const Vector3d centre = 1000 * normal_vector(rng), point = centre + 10 * normal_vector(rng);
    const std::vector<Ray> rays = rays_to(point, centre, 2 + i % 4, 0, rng);
    Triangulation result;
    ASSERT_TRUE(triangulate(rays, &result));
    EXPECT_LT((result.point - point).norm(), 1e-8 / result.parallax / result.parallax);
    EXPECT_LT(result.max_angle, 1e-7);
    EXPECT_LE(result.rms_angle, result.max_angle);
    if (rays.size() > 2) continue;
    Vector3d midpoint;
    ASSERT_TRUE(triangulate_midpoint(rays[0], rays[1], &midpoint));
    EXPECT_LT((midpoint - point).norm(), 1e-8 / result.parallax / result.parallax);
    EXPECT_NEAR(std::cos(result.parallax), rays[0].direction.dot(rays[1].direction), 1e-12);
  }
}

TEST(Triangulation, NoPointNearbyIsBetter) {
  Rng rng(2);
  for (int i = 0; i < 500; ++i) {
    const Vector3d point = Vector3d(0, 0, 12) + normal_vector(rng);
    const std::vector<Ray> rays = rays_to(point, Vector3d::Zero(), 2 + i % 5, 2e-3, rng);
    Triangulation result;
    ASSERT_TRUE(triangulate(rays, &result));
    const double cost = sum_of_squared_tangents(rays, result.point);
    for (const double step : {1e-4, 1e-2, 1.0}) {
      for (int k = 0; k < 20; ++k) {
        const Vector3d other = result.point + step * normal_vector(rng).normalized();
        EXPECT_GE(sum_of_squared_tangents(rays, other), cost * (1 - 1e-9));
      }
    }
  }
}

TEST(Triangulation, ReportsTheAnglesOfTheRays) {
  const std::vector<Ray> rays = {{{-1, 0, 0}, Vector3d(1, 1e-3, 5).normalized()},
                                 {{1, 0, 0}, Vector3d(-1, -1e-3, 5).normalized()}};
  Triangulation result;
  ASSERT_TRUE(triangulate(rays, &result));
  EXPECT_NEAR(result.point.y(), 0, 1e-9);
  EXPECT_NEAR(result.max_angle, 1e-3 / std::sqrt(26.0), 1e-8);
  EXPECT_NEAR(result.rms_angle, result.max_angle, 1e-9);
  EXPECT_NEAR(result.parallax, 2 * std::atan(0.2), 1e-6);
}

TEST(Triangulation, NoDepthNoPoint) {
  Triangulation result;
  Vector3d point;
  const Ray forward{{0, 0, 0}, Vector3d::UnitZ()};
  const Ray parallel{{1, 0, 0}, Vector3d::UnitZ()};
  const Ray opposite{{1, 0, 5}, -Vector3d::UnitZ()};
  const Ray diverging{{1, 0, 0}, Vector3d(1, 0, 5).normalized()};
  for (const Ray& other : {forward, parallel, opposite, diverging}) {
    EXPECT_FALSE(triangulate(std::array{forward, other}, &result));
    EXPECT_FALSE(triangulate_midpoint(forward, other, &point));
  }
  EXPECT_FALSE(triangulate(std::array{forward}, &result));
  EXPECT_FALSE(triangulate({}, &result));
  const Ray bad{{0, 0, std::numeric_limits<double>::quiet_NaN()}, Vector3d(1, 0, 5).normalized()};
  EXPECT_FALSE(triangulate(std::array{forward, bad}, &result));
  EXPECT_FALSE(triangulate_midpoint(forward, bad, &point));
}

TEST(Triangulation, AngleBetweenIsAccurateAtItsEnds) {
  for (const double angle : {0.0, 1e-12, 1e-6, 1.0, 3.0, std::numbers::pi - 1e-9, std::numbers::pi}) {
    const Vector3d a = Vector3d::UnitX(), b(std::cos(angle), std::sin(angle), 0);
    EXPECT_NEAR(angle_between(a, b), angle, 1e-15 + 1e-15 * angle);
  }
}

}  // namespace
}  // namespace raysfm
