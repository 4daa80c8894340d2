#include "raysfm/lenses/next_instant.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "support/test_scenes.h"

namespace raysfm {
namespace {

using test_scenes::add_noise;
using test_scenes::Cube;
using test_scenes::make_cube;
using test_scenes::project_all;
using test_scenes::structure_error;

// The object turns and deforms, the cameras turn after it and zoom.
Cube at_instant(const Cube& first, int instant, Rng* rng) {
  Cube cube = first;
  const Eigen::Quaterniond turn = exp_so3({0, 0.05 * instant, 0});
  for (Eigen::Vector3d& x : cube.truth.points) {
    x = turn * x + 0.01 * instant * Eigen::Vector3d(rng->normal(), rng->normal(), rng->normal());
  }
  for (size_t j = 0; j < cube.truth.lenses.size(); ++j) {
    Lens& lens = cube.truth.lenses[j];
    lens.fx = lens.fy = lens.fx * (1 + 0.02 * instant);
    Rigid3& pose = cube.truth.cam_from_world[j];
    pose.rotation = (exp_so3({0.01 * instant, 0, 0.02 * instant}) * pose.rotation).normalized();
  }
  project_all(cube.truth, &cube.tracks);
  return cube;
}

TEST(NextInstant, FollowsADeformingObjectThroughZooms) {
  Rng rng(11);
  const Cube first = make_cube({.images = 8, .zooming = true}, &rng);
  UncalibratedScene scene = first.truth;
  LensAdjustmentOptions options;
  options.lm.min_relative_decrease = 1e-12;
  for (int instant = 1; instant <= 5; ++instant) {
    const Cube cube = at_instant(first, instant, &rng);
    ASSERT_TRUE(adjust_next_instant(cube.tracks, options, &scene).ok());
    EXPECT_LT(structure_error(scene.points, cube.truth.points), 1e-6) << instant;
    for (size_t j = 0; j < scene.lenses.size(); ++j) {
      EXPECT_NEAR(scene.lenses[j].fx / cube.truth.lenses[j].fx, 1, 1e-5);
    }
  }
}

TEST(NextInstant, PointsAppearAndDisappear) {
  Rng rng(12);
  Cube cube = make_cube({.images = 6, .points = 30, .zooming = true}, &rng);
  add_noise(0.2, &rng, &cube.tracks);
  UncalibratedScene scene = cube.truth;
  const double nan = std::numeric_limits<double>::quiet_NaN();
  scene.points[3].setConstant(nan);  // new, and seen by all
  scene.points[7].setConstant(nan);  // new, and seen by one camera
  PointTracks tracks = cube.tracks;
  tracks.image.clear(), tracks.point.clear(), tracks.pixel.clear();
  for (int k = 0; k < cube.tracks.size(); ++k) {
    const int image = cube.tracks.image[k], point = cube.tracks.point[k];
    if (point == 5 || (point == 7 && image != 2)) continue;  // 5 has gone
    tracks.add(image, point, cube.tracks.pixel[k]);
  }
  const auto summary = adjust_next_instant(tracks, {}, &scene);
  ASSERT_TRUE(summary.ok()) << summary.error().message;
  EXPECT_EQ(summary->dropped, 1);
  EXPECT_EQ(scene.points[5], cube.truth.points[5]);
  EXPECT_FALSE(scene.points[7].allFinite());
  EXPECT_LT((scene.points[3] - cube.truth.points[3]).norm(), 0.05);
}

TEST(NextInstant, BadInputIsNamedAndTheSceneLeftAlone) {
  Rng rng(13);
  const Cube cube = make_cube({.images = 6, .zooming = true}, &rng);
  UncalibratedScene scene = cube.truth;
  scene.points.pop_back();
  const auto wrong_size = adjust_next_instant(cube.tracks, {}, &scene);
  ASSERT_FALSE(wrong_size.ok());
  EXPECT_EQ(wrong_size.error().message, "scene: 6 cameras and 24 points, must be 6 and 25 as in the tracks");
  EXPECT_EQ(scene.points.size(), 24u);
}

}  // namespace
}  // namespace raysfm
