#include "raysfm/uncalibrated/video_reconstruct.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>

#include "raysfm/uncalibrated/video_resection.h"
#include "support/test_scenes.h"

namespace raysfm {
namespace {

// A camera that walks past a wall of points 50 units wide, sees a few of them at a time, and zooms.
struct Walk {
  UncalibratedScene truth;
  PointTracks tracks;
  std::vector<uint8_t> keyframe;
};

Walk make_walk(int images, double zoom, double noise, double k1 = 0) {
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
      // Farther out the distortion would fold back into the image.
      if (!(x.z() > 1) || x.hnormalized().norm() > 1) continue;
      const Eigen::Vector2d m = (1 + k1 * x.hnormalized().squaredNorm()) * x.hnormalized();
      const Eigen::Vector2d p =
          walk.truth.lenses[j].pixel(m) + noise * Eigen::Vector2d(rng.normal(), rng.normal());
      if (p.x() > 0 && p.y() > 0 && p.x() < 639 && p.y() < 479) walk.tracks.add(j, i, p);
    }
  }
  return walk;
}

double worst_focal_error_of_posed(const Walk& walk, const UncalibratedReconstruction& result) {
  double worst = 0;
  for (size_t j = 0; j < walk.truth.lenses.size(); ++j) {
    if (!result.image_posed[j]) continue;
    worst = std::max(worst, std::abs(result.scene.lenses[j].fx / walk.truth.lenses[j].fx - 1));
  }
  return worst;
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

// A lens that bends lines is no zoom.
TEST(ReconstructVideo, OneLensOfAZoomShowsSignsOfIt) {
  for (const double zoom : {0.2, 0.1, 0.0}) {
    Walk walk = make_walk(24, zoom, 0.2, -0.05);
    walk.keyframe.assign(24, 1);
    const SolveOptions one{.lens = LensChange::kFixed};
    const auto fixed = reconstruct_video(walk.tracks, walk.keyframe, one);
    ASSERT_TRUE(fixed.ok()) << fixed.error().message;
    const ZoomSigns signs =
        signs_of_zoom(walk.tracks, walk.keyframe, one, ErrorRelation::kAlongTracks, *fixed);
    EXPECT_EQ(signs.zooms, zoom > 0) << zoom << ": " << signs.evidence;
  }
}

// Tracks end where the lens is turned: what goes on from the first part finds the other focal length.
TEST(ReconstructVideo, GoesOnFromAPartWithAnotherFocalLength) {
  constexpr int kImages = 48, kPart = 27;
  Walk walk = make_walk(kImages, 0, 0.2);
  for (int j = kPart; j < kImages; ++j) walk.truth.lenses[j].fx = walk.truth.lenses[j].fy = 625;
  PointTracks first = walk.tracks, all = walk.tracks;
  for (PointTracks* tracks : {&first, &all})
    tracks->image.clear(), tracks->point.clear(), tracks->pixel.clear();
  for (int k = 0; k < walk.tracks.size(); ++k) {
    const int j = walk.tracks.image[k];
    Eigen::Vector2d pixel = walk.tracks.pixel[k];
    if (j < kPart) first.add(j, walk.tracks.point[k], pixel);
    if (j >= kPart) pixel = walk.tracks.pixel[k] * 1.25 - 0.25 * Eigen::Vector2d(319.5, 239.5);
    all.add(j, walk.tracks.point[k], pixel);
  }
  const auto part = reconstruct_video(first, walk.keyframe, {.lens = LensChange::kFixed});
  ASSERT_TRUE(part.ok()) << part.error().message;
  ASSERT_EQ(std::ranges::count(part->image_posed, 1), kPart);
  UncalibratedReconstruction start = *part;
  start.inlier.assign(all.size(), 0);
  const auto result = reconstruct_video(all, walk.keyframe, {}, {.start = &start});
  ASSERT_TRUE(result.ok()) << result.error().message;
  EXPECT_TRUE(result->zooming) << result->lens_evidence;
  EXPECT_EQ(std::ranges::count(result->image_posed, 1), kImages);
  EXPECT_LT(worst_focal_error(walk, *result), 0.015);
}

TEST(ReconstructVideo, FixedLensIsNotTakenForAZoom) {
  const Walk walk = make_walk(72, 0, 0.2);
  const auto result = reconstruct_video(walk.tracks, walk.keyframe, {});
  ASSERT_TRUE(result.ok()) << result.error().message;
  EXPECT_FALSE(result->zooming) << result->lens_evidence;
  EXPECT_EQ(std::count(result->image_posed.begin(), result->image_posed.end(), 1), 72);
  EXPECT_LT(worst_focal_error(walk, *result), 0.01);
}

TEST(ReconstructVideo, DistortionIsFoundWithItsStandardDeviation) {
  const Walk walk = make_walk(60, 0, 0.2, -0.1);
  const auto result = reconstruct_video(walk.tracks, walk.keyframe, {});
  ASSERT_TRUE(result.ok()) << result.error().message;
  EXPECT_FALSE(result->zooming) << result->lens_evidence;
  EXPECT_NEAR(result->radial.k1, -0.1, 0.003);
  EXPECT_LT(std::abs(result->radial.k1 + 0.1), 5 * result->radial_sigma.k1);
  EXPECT_GT(std::count(result->image_posed.begin(), result->image_posed.end(), 1), 55);
  EXPECT_LT(worst_focal_error_of_posed(walk, *result), 0.005);
  EXPECT_LT(result->rms_px, 0.35);
  // Without it the focal length takes up what it can.
  const auto without = reconstruct_video(walk.tracks, walk.keyframe, {.radial = RadialChoice::kNone});
  ASSERT_TRUE(without.ok());
  EXPECT_TRUE(without->radial.none());
  EXPECT_GT(worst_focal_error_of_posed(walk, *without), 0.01);
}

// Images that an adjustment left out, or that came in with the distortion, have the lens of all, too.
TEST(ReconstructVideo, OneLensHasOneStandardDeviation) {
  const Walk walk = make_walk(60, 0, 0.2, -0.1);
  const auto result = reconstruct_video(walk.tracks, walk.keyframe, {.radial = RadialChoice::kIfSure});
  ASSERT_TRUE(result.ok()) << result.error().message;
  ASSERT_FALSE(result->zooming);
  const int first = result->first_posed();
  for (size_t j = first; j < walk.truth.lenses.size(); ++j) {
    if (!result->image_posed[j]) continue;
    const LensVector difference = result->scene.lenses[j].vector() - result->scene.lenses[first].vector();
    EXPECT_LT(difference.norm(), 1e-9) << j;
    EXPECT_LT((result->lens_sigma[j] - result->lens_sigma[first]).norm(), 1e-9) << j;
  }
}

TEST(ReconstructVideo, NoDistortionIsFoundWhereThereIsNone) {
  const Walk walk = make_walk(60, 0, 0.2);
  const auto sure = reconstruct_video(walk.tracks, walk.keyframe, {});
  ASSERT_TRUE(sure.ok()) << sure.error().message;
  EXPECT_TRUE(sure->radial.none());
  const auto free = reconstruct_video(walk.tracks, walk.keyframe,
                                      {.lens = LensChange::kFixed, .radial = RadialChoice::kFree});
  ASSERT_TRUE(free.ok()) << free.error().message;
  EXPECT_LT(std::abs(free->radial.k1), 4 * free->radial_sigma.k1);
}

TEST(ReconstructVideo, AnyNumberOfThreadsGivesTheSameBits) {
  const Walk walk = make_walk(40, 0.2, 0.3);
  const auto one = reconstruct_video(walk.tracks, walk.keyframe, {.threads = 1});
  const auto three = reconstruct_video(walk.tracks, walk.keyframe, {.threads = 3});
  ASSERT_TRUE(one.ok() && three.ok());
  for (size_t j = 0; j < walk.truth.lenses.size(); ++j) {
    EXPECT_EQ(one->scene.lenses[j].vector(), three->scene.lenses[j].vector());
    EXPECT_EQ(one->lens_sigma[j], three->lens_sigma[j]);
    EXPECT_EQ(one->scene.cam_from_world[j].translation, three->scene.cam_from_world[j].translation);
  }
  EXPECT_EQ(one->inlier, three->inlier);
}

TEST(ReconstructVideo, StopsWhereItIsToldTo) {
  const Walk walk = make_walk(120, 0, 0.2);
  std::atomic<bool> stop = false;
  int posed = 0;
  VideoOptions options;
  options.progress = [&](int count, int) { stop = (posed = count) >= 20; };
  options.stop = &stop;
  const auto result = reconstruct_video(walk.tracks, walk.keyframe, {.lens = LensChange::kFixed}, options);
  ASSERT_TRUE(result.ok()) << result.error().message;
  int keyframes = 0;
  for (size_t j = 0; j < walk.keyframe.size(); ++j) keyframes += walk.keyframe[j] && result->image_posed[j];
  EXPECT_EQ(keyframes, posed);
  EXPECT_LT(worst_focal_error_of_posed(walk, *result), 0.02);
}

TEST(ReconstructVideo, AdjustmentsEndWhenTheyAreToldTo) {
  const Walk walk = make_walk(120, 0, 0.2);
  std::atomic<bool> stop = false;
  VideoOptions video;
  video.progress = [&](int posed, int) { stop = posed >= 20; };
  video.stop = &stop;
  SolveOptions options;
  options.lens = LensChange::kFixed;
  options.go_on = [&](const IterationInfo&) { return !stop; };
  const auto result = reconstruct_video(walk.tracks, walk.keyframe, options, video);
  ASSERT_TRUE(result.ok()) << result.error().message;
  EXPECT_EQ(result->adjustment.lm.termination, Termination::kInterrupted);
  EXPECT_LE(result->adjustment.lm.iterations, 3);  // one in each round of weights
}

// Every long loop asks whether to go on; whenever it is told not to, hardly anything follows.
TEST(ReconstructVideo, EndsSoonWheneverItIsToldTo) {
  const Walk walk = make_walk(60, 0, 0.2);
  const auto asked_until = [&](int stop_at) {
    std::atomic<bool> stop = false;
    std::atomic<int> asked = 0;
    SolveOptions options;
    options.lens = LensChange::kFixed;
    options.go_on = [&](const IterationInfo&) {
      if (++asked >= stop_at) stop = true;
      return !stop;
    };
    VideoOptions video;
    video.stop = &stop;
    (void)reconstruct_video(walk.tracks, walk.keyframe, options, video);
    return asked.load();
  };
  const int whole = asked_until(std::numeric_limits<int>::max());
  EXPECT_GT(whole, 100);
  // One question ends an adjustment; between the end of growing and that of everything there are a few.
  const int between_frames = static_cast<int>(std::ranges::count(walk.keyframe, 0));
  for (const int part : {1, 2, 4, 6, 8, 9}) {
    const int stop_at = std::max(1, whole * part / 10);
    EXPECT_LT(asked_until(stop_at) - stop_at, 12 + between_frames) << part;
  }
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
