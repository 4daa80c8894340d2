#include "raysfm/mapping/planar_twin.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "raysfm/core/random.h"

namespace raysfm {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;

// A plane that leans before a camera that goes along a straight line and turns.
struct PlaneScene {
  std::vector<Rigid3> cam_from_world;
  std::vector<Vector3d> points;

  explicit PlaneScene(uint64_t seed) {
    Rng rng(seed);
    const auto uniform = [&] { return 2 * rng.uniform() - 1; };
    const Vector3d plane = Vector3d(0.6 * uniform(), 0.6 * uniform(), 1) / 4;
    const Vector3d direction = Vector3d(uniform(), uniform(), uniform()).normalized();
    const Vector3d axis = Vector3d(uniform(), uniform(), uniform()).normalized();
    const Rigid3 first{Quaterniond(Eigen::AngleAxisd(0.4, axis)), {1, 2, 3}};
    for (int k = 0; k < 2; ++k) {
      const Quaterniond turn(Eigen::AngleAxisd(0.2 * k, axis));
      cam_from_world.push_back(Rigid3{turn, -(turn * (0.7 * k * direction))} * first);
    }
    for (int i = 0; i < 60; ++i) {
      const Vector3d ray = Vector3d(0.5 * uniform(), 0.5 * uniform(), 1);
      points.push_back(first.inverse() * (ray / plane.dot(ray)));
    }
  }

  // The largest angle between where two scenes show a point.
  double apart(const PlaneScene& other) const {
    double most = 0;
    for (size_t k = 0; k < cam_from_world.size(); ++k) {
      for (size_t i = 0; i < points.size(); ++i) {
        const Vector3d a = (cam_from_world[k] * points[i]).normalized();
        const Vector3d b = (other.cam_from_world[k] * other.points[i]).normalized();
        most = std::max(most, a.cross(b).norm());
      }
    }
    return most;
  }

  // Points beyond it are on no plane.
  bool sees_horizon() const {
    const auto depth = [&](const Vector3d& x) { return (cam_from_world[0] * x).norm(); };
    return std::ranges::max(points, {}, depth).norm() > 5 * std::ranges::min(points, {}, depth).norm();
  }

  double turned_from(const PlaneScene& other) const {
    return cam_from_world[1].rotation.angularDistance(other.cam_from_world[1].rotation);
  }
};

TEST(PlanarTwin, TwoViewsLookTheSame) {
  int twins = 0;
  for (uint64_t seed = 1; seed <= 50; ++seed) {
    const PlaneScene scene(seed);
    PlaneScene twin = scene;
    if (!take_planar_twin(twin.cam_from_world, twin.points) || twin.sees_horizon()) continue;
    twins += twin.turned_from(scene) > 0.1;
    EXPECT_LT(scene.apart(twin), 1e-9) << seed;
    PlaneScene again = twin;
    ASSERT_TRUE(take_planar_twin(again.cam_from_world, again.points)) << seed;
    EXPECT_LT(again.turned_from(scene), 1e-9) << seed;
  }
  EXPECT_GT(twins, 8) << "they are the same";
}

TEST(PlanarTwin, ACameraThatDoesNotMoveHasNone) {
  PlaneScene scene(1);
  scene.cam_from_world[1] =
      Rigid3{Quaterniond(Eigen::AngleAxisd(0.1, Vector3d::UnitX())), {0, 0, 0}} * scene.cam_from_world[0];
  const PlaneScene before = scene;
  EXPECT_FALSE(take_planar_twin(scene.cam_from_world, scene.points));
  EXPECT_EQ(scene.points, before.points);
}

}  // namespace
}  // namespace raysfm
