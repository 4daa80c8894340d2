#include "raysfm/uncalibrated/video_reconstruct.h"

#include <gtest/gtest.h>

#include <cmath>

#include "raysfm/uncalibrated/test_scenes.h"
#include "raysfm/uncalibrated/video_resection.h"

namespace raysfm {
namespace {

// A camera that walks past a wall of points 50 units wide, sees a few of them at a time, and zooms.
struct Walk {
  UncalibratedScene truth;
  PointTracks tracks;
  std::vector<uint8_t> keyframe;
};

Walk make_walk(int images, double zoom, double noise) {
  Rng rng(5);
  Walk walk;
  for (int i = 0; i < 900; ++i) {
    walk.truth.points.emplace_back(rng.uniform(-10, 40), rng.uniform(-5, 5), rng.uniform(6, 14));
  }
  walk.tracks = {.image_count = images,
                 .point_count = 900,
                 .image_size = {640, 480},
                 .image = {},
                 .point = {},
                 .pixel = {}};
  for (int j = 0; j < images; ++j) {
    const double s = double(j) / (images - 1);
    const Eigen::Vector3d turn(0.15 * std::sin(9 * s), 0.25 * std::sin(7 * s), 0.2 * std::sin(11 * s));
    const Eigen::Quaterniond rotation = exp_so3(turn);
    const Eigen::Vector3d centre(30 * s, 0.8 * std::sin(8 * s), 1.5 * std::sin(10 * s));
    walk.truth.cam_from_world.push_back({rotation, -(rotation * centre)});
    const double focal = 500 * (1 + zoom * std::sin(5 * s));
    walk.truth.lenses.push_back({focal, focal, 319.5, 239.5, 0});
    walk.keyframe.push_back(j % 3 == 0);
    for (int i = 0; i < 900; ++i) {
      const Eigen::Vector3d x = walk.truth.cam_from_world[j] * walk.truth.points[i];
      if (!(x.z() > 1)) continue;
      const Eigen::Vector2d p =
          walk.truth.lenses[j].pixel(x.hnormalized()) + noise * Eigen::Vector2d(rng.normal(), rng.normal());
      if (p.x() > 0 && p.y() > 0 && p.x() < 639 && p.y() < 479) walk.tracks.add(j, i, p);
    }
  }
  return walk;
}

double worst_focal_error(const Walk& walk, const UncalibratedReconstruction& result) {
  double worst = 0;
  for (size_t j = 0; j < walk.truth.lenses.size(); ++j) {
    worst = std::max(worst, std::abs(result.scene.lenses[j].fx / walk.truth.lenses[j].fx - 1));
  }
  return worst;
}

TEST(ReconstructVideo, ZoomIsFoundAndEveryImagePosed) {
  const Walk walk = make_walk(72, 0.2, 0.2);
  const auto result = reconstruct_video(walk.tracks, walk.keyframe, {});
  ASSERT_TRUE(result.ok()) << result.error().message;
  EXPECT_TRUE(result->zooming) << result->lens_evidence;
  EXPECT_EQ(std::count(result->image_posed.begin(), result->image_posed.end(), 1), 72);
  EXPECT_LT(worst_focal_error(walk, *result), 0.03);
  EXPECT_LT(result->rms_px, 0.4);
}

TEST(ReconstructVideo, FixedLensIsNotTakenForAZoom) {
  const Walk walk = make_walk(72, 0, 0.2);
  const auto result = reconstruct_video(walk.tracks, walk.keyframe, {});
  ASSERT_TRUE(result.ok()) << result.error().message;
  EXPECT_FALSE(result->zooming) << result->lens_evidence;
  EXPECT_EQ(std::count(result->image_posed.begin(), result->image_posed.end(), 1), 72);
  EXPECT_LT(worst_focal_error(walk, *result), 0.01);
}

TEST(ReconstructVideo, RefusesMarksThatDoNotFit) {
  const Walk walk = make_walk(6, 0, 0);
  const std::vector<uint8_t> few(5, 1);
  const auto result = reconstruct_video(walk.tracks, few, {});
  ASSERT_FALSE(result.ok());
  EXPECT_EQ(result.error().kind, ErrorKind::kBadInput);
}

TEST(ResectWithLens, FindsPoseAndFocalLengthBesideOutliers) {
  const Walk walk = make_walk(30, 0.2, 0);
  Rng rng(3);
  std::vector<Eigen::Vector3d> points;
  std::vector<Eigen::Vector2d> pixels;
  for (int k = 0; k < walk.tracks.size(); ++k) {
    if (walk.tracks.image[k] != 10) continue;
    points.push_back(walk.truth.points[walk.tracks.point[k]]);
    const bool wrong = points.size() % 5 == 0;
    pixels.push_back(wrong ? Eigen::Vector2d(rng.uniform(0, 640), rng.uniform(0, 480))
                           : walk.tracks.pixel[k]);
  }
  // From the image before, whose lens is another.
  LensResection view;
  ASSERT_TRUE(resect_with_lens(points, pixels, walk.truth.cam_from_world[9], walk.truth.lenses[9],
                               {.zooming = true}, &view));
  EXPECT_NEAR(view.lens.fx / walk.truth.lenses[10].fx, 1, 1e-3);
  EXPECT_NEAR(
      (view.cam_from_world.inverse().translation - walk.truth.cam_from_world[10].inverse().translation)
          .norm(),
      0, 0.02);
  EXPECT_GE(view.inlier_count, int(points.size()) * 79 / 100);
  // Nothing but outliers.
  for (Eigen::Vector2d& p : pixels) p = {rng.uniform(0, 640), rng.uniform(0, 480)};
  EXPECT_FALSE(resect_with_lens(points, pixels, walk.truth.cam_from_world[9], walk.truth.lenses[9],
                                {.zooming = true}, &view));
}

}  // namespace
}  // namespace raysfm
