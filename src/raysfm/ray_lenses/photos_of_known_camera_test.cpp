#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <numeric>
#include <vector>

#include "raysfm/core/random.h"
#include "raysfm/eval/alignment.h"
#include "raysfm/geometry/rotation.h"
#include "raysfm/ray_lenses/photos_of_one_lens.h"
#include "raysfm/ray_lenses/ray_reconstruction.h"
#include "raysfm/ray_lenses/threes_in_sight.h"

namespace raysfm {
namespace {

// Photos all round a ball of points, in any order: each sees the half that faces it, with noise of 0.3
// pixels.
struct Photos {
  Camera camera;
  std::vector<Rigid3> cam_from_world;
  PointTracks tracks;
};

Camera fisheye() {
  Camera camera;
  camera.model = KannalaBrandt{218, 218, 324, 235, 0.02, -0.004};
  camera.width = 640, camera.height = 480;
  return camera;
}

Photos take_photos(int images, double wrong, const Camera& camera = fisheye()) {
  constexpr int kPoints = 1200;
  Photos photos{.camera = camera, .cam_from_world = {}, .tracks = {}};
  Rng rng(11);
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i < kPoints; ++i)
    points.push_back(Eigen::Vector3d(rng.normal(), rng.normal(), rng.normal()).normalized());
  std::vector<int> order(images);
  std::iota(order.begin(), order.end(), 0);
  for (int j = images - 1; j > 0; --j) std::swap(order[j], order[rng.index(static_cast<uint32_t>(j + 1))]);
  photos.tracks.image_count = images;
  photos.tracks.point_count = kPoints;
  photos.tracks.image_size = {640, 480};
  for (int j = 0; j < images; ++j) {
    const double a = 6.283 * order[j] / images;
    const Eigen::Vector3d centre(3 * std::sin(a), 0.4 * std::sin(3 * a), -3 * std::cos(a));
    const Eigen::Quaterniond rotation = exp_so3(Eigen::Vector3d(0.1 * std::sin(5 * a), a, 0));
    photos.cam_from_world.push_back({rotation, -(rotation * centre)});
    for (int i = 0; i < kPoints; ++i) {
      const Eigen::Vector3d in_cam = photos.cam_from_world[j] * points[i];
      Eigen::Vector2d pixel;
      if (points[i].dot(centre.normalized()) < 0.3 || !photos.camera.project(in_cam, &pixel)) continue;
      pixel += 0.3 * Eigen::Vector2d(rng.normal(), rng.normal());
      if (rng.uniform() < wrong) pixel = {rng.uniform(200, 440), rng.uniform(140, 340)};
      if (photos.camera.contains(pixel)) photos.tracks.add(j, i, pixel);
    }
  }
  return photos;
}

RayReconstruction reconstructed(const Photos& photos) {
  return reconstruct_along_rays(photos.tracks, photos.camera, {.is_known = true, .in_order = false});
}

// Of the centres of the cameras that have a pose, after a similarity; the ball has a radius of 1.
double largest_error(const Photos& photos, const RayReconstruction& r) {
  std::vector<Eigen::Vector3d> truth, found;
  for (size_t j = 0; j < r.image_posed.size(); ++j) {
    if (!r.image_posed[j]) continue;
    truth.push_back(photos.cam_from_world[j].inverse().translation);
    found.push_back(r.cam_from_world[j].inverse().translation);
  }
  const auto columns = [](const std::vector<Eigen::Vector3d>& all) {
    return Eigen::Map<const Eigen::Matrix3Xd>(all[0].data(), 3, static_cast<Eigen::Index>(all.size()));
  };
  const Similarity3 truth_from_found = align_points(columns(found), columns(truth), Alignment::kSim3);
  double largest = 0;
  for (size_t i = 0; i < truth.size(); ++i)
    largest = std::max(largest, (truth_from_found * found[i] - truth[i]).norm());
  return largest;
}

TEST(PhotosOfKnownCamera, AllArePosedRoundABallThoughMatchesAreWrong) {
  for (const double wrong : {0.0, 0.15}) {
    const Photos photos = take_photos(24, wrong);
    const RayReconstruction r = reconstructed(photos);
    ASSERT_EQ(r.posed, 24) << wrong;
    EXPECT_LT(largest_error(photos, r), 0.01) << wrong;
    EXPECT_EQ(r.camera.pixels_per_radian(), photos.camera.pixels_per_radian()) << "the camera is known";
  }
}

// A photo that shows another ball: what it sees was taken for points of this one.
TEST(PhotosOfKnownCamera, WhatDoesNotBelongIsLeftOut) {
  Photos photos = take_photos(24, 0);
  Rng rng(4);
  for (int k = 0; k < photos.tracks.size(); ++k) {
    // A sixteenth agrees with a pose by chance, or for what stands near.
    if (photos.tracks.image[k] == 7 && rng.uniform() < 0.94)
      photos.tracks.pixel[k] = {rng.uniform(200, 440), rng.uniform(140, 340)};
  }
  const RayReconstruction r = reconstructed(photos);
  EXPECT_EQ(r.posed, 23);
  EXPECT_FALSE(r.image_posed[7]);
  EXPECT_LT(largest_error(photos, r), 0.01);
}

TEST(PhotosOfKnownCamera, TwoPlacesThatSeeNothingInCommonAreTheLargerOne) {
  const Photos large = take_photos(24, 0), small = take_photos(7, 0);
  Photos both = large;
  both.tracks.image_count += 7;
  both.tracks.point_count += small.tracks.point_count;
  for (int k = 0; k < small.tracks.size(); ++k) {
    both.tracks.add(24 + small.tracks.image[k], large.tracks.point_count + small.tracks.point[k],
                    small.tracks.pixel[k]);
  }
  const RayReconstruction r = reconstructed(both);
  EXPECT_EQ(r.posed, 24);
  for (int j = 24; j < 31; ++j) EXPECT_FALSE(r.image_posed[j]) << j;
}

// What is seen of a part of the photos alone, and then of all.
TEST(PhotosOfKnownCamera, GoesOnFromAReconstructionOfAPart) {
  const Photos photos = take_photos(24, 0.1);
  const auto is_late = [](int image) { return image % 6 == 0; };
  PointTracks part = photos.tracks;
  part.image.clear(), part.point.clear(), part.pixel.clear();
  for (int k = 0; k < photos.tracks.size(); ++k) {
    if (is_late(photos.tracks.image[k])) continue;
    part.add(photos.tracks.image[k], photos.tracks.point[k], photos.tracks.pixel[k]);
  }
  const RayReconstruction start =
      reconstruct_along_rays(part, photos.camera, {.is_known = true, .in_order = false});
  ASSERT_EQ(start.posed, 20);
  const RayReconstruction all = reconstruct_along_rays(
      photos.tracks, photos.camera, {.is_known = true, .in_order = false, .start = &start});
  EXPECT_EQ(all.posed, 24);
  EXPECT_EQ(all.start_images, start.start_images);
  EXPECT_LT(largest_error(photos, all), 0.01);
}

constexpr double kFocal = 1100;

Photos photos_of_one_lens() {
  Camera camera;
  camera.width = 640, camera.height = 480;
  camera.model = Radtan{kFocal, kFocal, 324, 235, -0.05, 0.1};
  return take_photos(18, 0.05, camera);
}

TEST(PhotosOfOneLens, TheFocalLengthIsFoundFromGuesses) {
  const Photos photos = photos_of_one_lens();
  const RayReconstruction r =
      reconstruct_photos_of_one_lens(photos.tracks, 0, {.in_order = false, .threads = 2});
  ASSERT_EQ(r.posed, 18);
  EXPECT_NEAR(std::get<Radtan>(r.camera.model).fx, kFocal, 0.02 * kFocal);
  EXPECT_LT(largest_error(photos, r), 0.03);
}

// What agreed before a lens is changed takes part in what follows, however far off it is then.
TEST(PhotosOfOneLens, GuessesFarTooShortAndFarTooLongComeOutRight) {
  const Photos photos = photos_of_one_lens();
  const double by_truth = agreeing_share(photos.tracks, reconstructed(photos));
  for (const double guess : {0.3 * kFocal, 0.8 * kFocal, 1.7 * kFocal, 3.5 * kFocal}) {
    Camera camera = photos.camera;
    camera.model = Radtan{guess, guess, 319.5, 239.5};
    const RayReconstruction r =
        reconstruct_along_rays(photos.tracks, camera, {.in_order = false, .threads = 2});
    EXPECT_EQ(r.posed, 18) << guess;
    EXPECT_NEAR(std::get<Radtan>(r.camera.model).fx, kFocal, 0.02 * kFocal) << guess;
    EXPECT_GT(agreeing_share(photos.tracks, r), 0.99 * by_truth) << guess;
  }
}

TEST(ThreesInSight, SeeEnoughInCommonAndTheSecondIsBetweenTheOthers) {
  const Photos photos = take_photos(24, 0);
  std::vector<std::vector<int>> of_image(24);
  for (int k = 0; k < photos.tracks.size(); ++k) of_image[photos.tracks.image[k]].push_back(k);
  const auto threes = threes_in_sight(photos.tracks, of_image);
  ASSERT_GT(threes.size(), 20u);
  EXPECT_LT(threes.size(), 300u);
  const auto distance = [&](int a, int b) {
    return (photos.cam_from_world[a].inverse().translation - photos.cam_from_world[b].inverse().translation)
        .norm();
  };
  int between = 0;
  for (const auto& [first, second, last] : threes) {
    between += distance(first, last) >= std::max(distance(first, second), distance(second, last));
  }
  EXPECT_GT(between, 0.8 * static_cast<double>(threes.size()));
}

}  // namespace
}  // namespace raysfm
