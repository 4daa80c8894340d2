#include "raysfm/uncalibrated/scene_growth.h"

#include <gtest/gtest.h>

#include <cmath>

#include "support/test_scenes.h"

namespace raysfm {
namespace {

using test_scenes::add_noise;
using test_scenes::Cube;
using test_scenes::make_cube;

// The two poses that stay where they are; all others as they would be without a scale.
void expect_true_poses(const UncalibratedScene& found, const UncalibratedScene& truth, int first,
                       int second) {
  const auto relative = [&](const UncalibratedScene& scene, int j) {
    return scene.cam_from_world[j] * scene.cam_from_world[first].inverse();
  };
  const double scale =
      relative(truth, second).translation.norm() / relative(found, second).translation.norm();
  for (size_t j = 0; j < truth.cam_from_world.size(); ++j) {
    const Rigid3 a = relative(found, static_cast<int>(j)), b = relative(truth, static_cast<int>(j));
    EXPECT_LT(a.rotation.angularDistance(b.rotation), 1e-4) << j;
    EXPECT_LT((scale * a.translation - b.translation).norm(), 1e-3 * b.translation.norm() + 1e-6) << j;
  }
}

TEST(SceneGrowth, AllImagesFromTwoOfAKnownFocalLength) {
  Rng rng(1);
  const Cube cube = make_cube({.images = 8, .points = 60}, &rng);
  const auto pair = farthest_pair(ImageObservations(cube.tracks), 1, 500, 0);
  ASSERT_TRUE(pair.ok());
  GrowingScene scene;
  ASSERT_TRUE(euclidean_start(cube.tracks, *pair, 1000, {}, &scene));
  EXPECT_EQ(scene.posed(), 2);
  place_left_points(cube.tracks, 1, &scene);
  EXPECT_EQ(std::ranges::count(scene.point_placed, 1), 60);
  EXPECT_EQ(pose_left_images(cube.tracks, {}, false, &scene), 6);
  expect_true_poses(scene.scene, cube.truth, pair->images[0], pair->images[1]);
}

TEST(SceneGrowth, AnotherFocalLengthIsFound) {
  Rng rng(2);
  Cube cube = make_cube({.images = 6, .points = 60, .zooming = true}, &rng);
  GrowingScene scene{cube.truth, std::vector<uint8_t>(6, 1), std::vector<uint8_t>(60, 1)};
  for (const int left : {1, 4}) {
    scene.image_posed[left] = 0;
    scene.scene.cam_from_world[left] = {};
    scene.scene.lenses[left] = {};
  }
  EXPECT_EQ(pose_left_images(cube.tracks, {}, true, &scene), 2);
  for (const int left : {1, 4}) {
    EXPECT_NEAR(scene.scene.lenses[left].fx, cube.truth.lenses[left].fx, 1) << left;
  }
  expect_true_poses(scene.scene, cube.truth, 0, 2);
}

TEST(SceneGrowth, AnImageOfOtherPointsStaysOut) {
  Rng rng(3);
  Cube cube = make_cube({.images = 6, .points = 60}, &rng);
  for (int k = 0; k < cube.tracks.size(); ++k) {
    if (cube.tracks.image[k] == 5) cube.tracks.pixel[k] = {rng.uniform(0, 500), rng.uniform(0, 500)};
  }
  GrowingScene scene{cube.truth, {1, 1, 1, 1, 0, 0}, std::vector<uint8_t>(60, 1)};
  EXPECT_EQ(pose_left_images(cube.tracks, {}, false, &scene), 1);
  EXPECT_TRUE(scene.image_posed[4]);
  EXPECT_FALSE(scene.image_posed[5]);
}

TEST(FarthestPair, FurtherPairsHaveOtherImages) {
  Rng rng(4);
  const Cube cube = make_cube({.images = 6, .points = 60}, &rng);
  const ImageObservations observations(cube.tracks);
  std::vector<int> taken(6, 0);
  for (int rank = 0; rank < 2; ++rank) {
    const auto pair = farthest_pair(observations, 1, 500, 0, rank);
    ASSERT_TRUE(pair.ok()) << pair.error().message;
    EXPECT_EQ(taken[pair->images[0]]++ + taken[pair->images[1]]++, 0) << rank;
  }
  EXPECT_FALSE(farthest_pair(observations, 1, 500, 0, 3));
}

// Another small distortion in each image, which no model has: a lens for each image lowers the errors and is
// no better for it.
TEST(Photos, WhatALensLacksIsNoZoom) {
  Rng rng(5);
  Cube cube = make_cube({.images = 8, .points = 300}, &rng);
  add_noise(0.25, &rng, &cube.tracks);
  std::vector<double> k1(8);
  for (double& k : k1) k = 0.4 * rng.normal();
  for (int k = 0; k < cube.tracks.size(); ++k) {
    const Eigen::Vector2d m = (cube.tracks.pixel[k] - cube.tracks.centre()) / 1000;
    cube.tracks.pixel[k] += 1000 * k1[cube.tracks.image[k]] * m.squaredNorm() * m;
  }
  const auto independent = reconstruct(cube.tracks, {});
  const auto photos = reconstruct(cube.tracks, {.errors = ErrorRelation::kWithinImages});
  ASSERT_TRUE(independent.ok() && photos.ok());
  EXPECT_TRUE(independent->zooming) << independent->lens_evidence;
  EXPECT_FALSE(photos->zooming) << photos->lens_evidence;
}

// One image sees points of a plane alone: no six of them give its view, three give its pose once there is a
// lens.
TEST(Photos, ImagesThatAreLeftOutArePosedByTheLens) {
  Rng rng(6);
  Cube cube = make_cube({.images = 8, .points = 120}, &rng);
  for (int i = 0; i < 40; ++i) cube.truth.points[i].z() = 0;
  test_scenes::project_all(cube.truth, &cube.tracks);
  add_noise(0.2, &rng, &cube.tracks);
  PointTracks tracks = cube.tracks;
  tracks.image.clear(), tracks.point.clear(), tracks.pixel.clear();
  for (int k = 0; k < cube.tracks.size(); ++k) {
    if (cube.tracks.image[k] == 5 && cube.tracks.point[k] >= 40) continue;
    tracks.add(cube.tracks.image[k], cube.tracks.point[k], cube.tracks.pixel[k]);
  }
  const SolveOptions fixed{.lens = LensChange::kFixed};
  SolveOptions of_photos = fixed;
  of_photos.errors = ErrorRelation::kWithinImages;
  const auto plain = reconstruct(tracks, fixed), photos = reconstruct(tracks, of_photos);
  ASSERT_TRUE(plain.ok() && photos.ok());
  EXPECT_FALSE(plain->image_posed[5]);
  EXPECT_TRUE(photos->image_posed[5]);
  const Rigid3 found = photos->scene.cam_from_world[5] * photos->scene.cam_from_world[0].inverse();
  const Rigid3 truth = cube.truth.cam_from_world[5] * cube.truth.cam_from_world[0].inverse();
  EXPECT_LT(found.rotation.angularDistance(truth.rotation), 0.01);
}

}  // namespace
}  // namespace raysfm
