#include "raysfm/ray_lenses/wide_lens.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "raysfm/core/random.h"
#include "raysfm/geometry/rotation.h"
#include "raysfm/uncalibrated/video_reconstruct.h"

namespace raysfm {
namespace {

// Points all round a camera that walks and looks about; tracks with noise of 0.2 pixels.
struct Room {
  std::vector<Rigid3> cam_from_world;
  PointTracks tracks;
};

Room film(const Camera& camera, int images = 14, int point_count = 900) {
  Rng rng(3);
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i < point_count; ++i) {
    const Eigen::Vector3d direction(rng.normal(), rng.normal(), rng.normal());
    points.push_back(rng.uniform(3, 8) * direction.normalized());
  }
  Room room;
  room.tracks.image_count = images;
  room.tracks.point_count = point_count;
  room.tracks.image_size = {double(camera.width), double(camera.height)};
  for (int j = 0; j < images; ++j) {
    const double s = double(j) / (images - 1);
    const Eigen::Vector3d turn(0.2 * std::sin(7 * s), 0.7 * s, 0.2 * std::sin(5 * s));
    const Eigen::Quaterniond rotation = exp_so3(turn);
    const Eigen::Vector3d centre(1.6 * s, 0.3 * std::sin(6 * s), 0.4 * std::sin(4 * s));
    room.cam_from_world.push_back({rotation, -(rotation * centre)});
    for (int i = 0; i < point_count; ++i) {
      Eigen::Vector2d pixel;
      if (!camera.project(room.cam_from_world[j] * points[i], &pixel)) continue;
      pixel += 0.2 * Eigen::Vector2d(rng.normal(), rng.normal());
      if (camera.contains(pixel)) room.tracks.add(j, i, pixel);
    }
  }
  return room;
}

Camera camera_of(const CameraModel& model) {
  Camera camera;
  camera.model = model;
  camera.width = 640, camera.height = 480;
  return camera;
}

// About 170 degrees from side to side.
const KannalaBrandt kFisheye{218, 218, 324, 235, 0.02, -0.004};

// The largest angle between rays of two cameras, over the image, in pixels.
double largest_difference(const Camera& a, const Camera& b) {
  double worst = 0;
  for (double x = 0; x < 640; x += 40) {
    for (double y = 0; y < 480; y += 40) {
      Ray in_a, in_b;
      if (!a.ray({x, y}, &in_a) || !b.ray({x, y}, &in_b)) return INFINITY;
      worst = std::max(worst, std::acos(std::min(1.0, in_a.direction.dot(in_b.direction))));
    }
  }
  return worst * a.pixels_per_radian();
}

UncalibratedReconstruction perspective_of(const PointTracks& tracks) {
  SolveOptions options;
  options.lens = LensChange::kFixed;
  const std::vector<uint8_t> all(tracks.image_count, 1);
  const auto found = reconstruct_video(tracks, all, options);
  EXPECT_TRUE(found.ok()) << found.error().message;
  return found.ok() ? *found : UncalibratedReconstruction();
}

PerspectiveFit fit_of(const UncalibratedReconstruction& r) {
  return {r.scene, r.radial, r.image_posed, r.point_placed, r.inlier};
}

// Of a film whose perspective lens is doubted.
WideLensSearch searched(const PointTracks& tracks) {
  const UncalibratedReconstruction perspective = perspective_of(tracks);
  const PerspectiveFit fit = fit_of(perspective);
  EXPECT_TRUE(may_be_wide_lens(tracks, fit));
  WideLensSearch search = find_wide_lens(tracks, &fit, {});
  EXPECT_TRUE(search.compared);
  return search;
}

class AlongRays : public testing::TestWithParam<double> {};

TEST_P(AlongRays, LensIsFoundFromAGuessFarOff) {
  const Camera truth = camera_of(kFisheye);
  const Room room = film(truth);
  const double focal = GetParam() * kFisheye.fx;
  const RayReconstruction r =
      reconstruct_along_rays(room.tracks, camera_of(KannalaBrandt{focal, focal, 319.5, 239.5}), {});
  ASSERT_EQ(r.posed, 14);
  // A turn of the camera as a whole moves the principal point and all rays alike.
  EXPECT_LT(largest_difference(truth, r.camera), 1);
  const double found = r.camera.pixels_per_radian();
  EXPECT_LT(std::abs(std::log(found / kFisheye.fx)), 4 * r.sigma.focal);
  EXPECT_LT(r.sigma.focal, 0.005);
  EXPECT_LT(r.strain, 4);
  EXPECT_GT(std::ranges::count(r.inlier, 1), 0.9 * room.tracks.size());
  for (int j = 1; j < 14; ++j) {
    const Rigid3 true_motion = room.cam_from_world[j] * room.cam_from_world[0].inverse();
    const Rigid3 motion = r.cam_from_world[j] * r.cam_from_world[0].inverse();
    EXPECT_LT(motion.rotation.angularDistance(true_motion.rotation), 0.003);
  }
}
INSTANTIATE_TEST_SUITE_P(Guesses, AlongRays, testing::Values(0.65, 1.0, 1.6));

// What is wrong with a guess makes larger errors in larger images.
TEST(RayLens, LensOfALargeImageIsFoundFromAGuessFarOff) {
  Camera truth = camera_of(KannalaBrandt{873, 873, 1297, 941, 0.02, -0.004});
  truth.width = 2560, truth.height = 1920;
  for (const double factor : {0.65, 1.6}) {
    Camera guess = truth;
    guess.model = KannalaBrandt{factor * 873, factor * 873, 1279.5, 959.5};
    const RayReconstruction r = reconstruct_along_rays(film(truth).tracks, guess, {});
    EXPECT_EQ(r.posed, 14);
    EXPECT_NEAR(r.camera.pixels_per_radian(), 873, 2);
    EXPECT_LT(r.sigma.focal, 0.005);
  }
}

TEST(RayLens, TooFewPointsAreNoStart) {
  Room room = film(camera_of(kFisheye), 5);
  PointTracks few = room.tracks;
  few.image.clear(), few.point.clear(), few.pixel.clear();
  for (int k = 0; k < room.tracks.size(); ++k) {
    if (room.tracks.point[k] < 40) few.add(room.tracks.image[k], room.tracks.point[k], room.tracks.pixel[k]);
  }
  EXPECT_EQ(reconstruct_along_rays(few, camera_of(kFisheye), {}).posed, 0);
}

// What the polynomial of a fisheye has to do to follow such a lens shows.
TEST(RayLens, BarrelDistortionStrainsAFisheye) {
  const Room room = film(camera_of(Radtan{290, 290, 318, 243, -0.3, 0.08}));
  const RayReconstruction r =
      reconstruct_along_rays(room.tracks, camera_of(KannalaBrandt{262, 262, 319.5, 239.5}), {});
  ASSERT_EQ(r.posed, 14);
  EXPECT_GT(r.strain, 10);
}

TEST(WideLens, FisheyeIsToldFromAPerspectiveLens) {
  const Camera truth = camera_of(kFisheye);
  const Room room = film(truth);
  const WideLensSearch search = searched(room.tracks);
  ASSERT_TRUE(search.found) << search.evidence;
  EXPECT_LT(largest_difference(truth, search.found->camera), 1);
}

// 93 degrees from side to side, bent inwards by a fifth at the corners.
TEST(WideLens, BarrelDistortionIsNoFisheye) {
  const Room room = film(camera_of(Radtan{350, 350, 316, 243, -0.2, 0.03}));
  const WideLensSearch search = searched(room.tracks);
  EXPECT_FALSE(search.found) << search.evidence;
}

TEST(WideLens, FisheyeIsFoundWhereNoPerspectiveLensIs) {
  const Camera truth = camera_of(kFisheye);
  const Room room = film(truth);
  const WideLensSearch search = find_wide_lens(room.tracks, nullptr, {});
  ASSERT_TRUE(search.found);
  EXPECT_LT(largest_difference(truth, search.found->camera), 1);
}

TEST(WideLens, OfManyObservationsAPartIsLookedAt) {
  const Room room = film(camera_of(kFisheye), 14, 8000);
  ASSERT_GT(room.tracks.size(), 45000);
  const WideLensSearch by_tracks[] = {find_wide_lens(room.tracks, nullptr, {}), searched(room.tracks)};
  for (const WideLensSearch& search : by_tracks) {
    ASSERT_TRUE(search.found);
    EXPECT_LT(search.found->inlier.size(), 40000);
    EXPECT_GT(search.found->inlier.size(), 20000);
    EXPECT_LT(largest_difference(camera_of(kFisheye), search.found->camera), 1);
  }
}

// 88 degrees from side to side.
TEST(WideLens, PerspectiveLensIsNoFisheyeWhereNoneIsFound) {
  const Room room = film(camera_of(Pinhole{330, 330, 316, 243}));
  EXPECT_FALSE(find_wide_lens(room.tracks, nullptr, {}).found);
}

// From the first guess all images may have a pose, and nothing is known of the lens.
TEST(WideLens, AGuessThatTellsNoLensIsNotTheLast) {
  for (const double degrees : {85, 90, 110}) {
    Camera truth;
    truth.width = 1280, truth.height = 960;
    const double focal = 1280 / (degrees * std::numbers::pi / 180);
    truth.model = KannalaBrandt{focal, focal, 647, 476, -0.02, 0.003};
    for (const int images : {4, 5, 6}) {
      const WideLensSearch search = find_wide_lens(film(truth, images).tracks, nullptr, {});
      ASSERT_TRUE(search.found) << degrees << " degrees, " << images << " images";
      EXPECT_NEAR(search.found->camera.pixels_per_radian(), focal, 0.005 * focal);
    }
  }
}

TEST(WideLens, UsualLensesAreNotLookedAtTwice) {
  UncalibratedReconstruction perspective;
  perspective.image_posed = {0, 1};
  perspective.scene.lenses = {Lens{}, Lens{500, 500, 320, 240}};
  const PointTracks tracks{
      .image_count = 2, .point_count = 0, .image_size = {640, 480}, .image = {}, .point = {}, .pixel = {}};
  perspective.radial = {-0.12, 0.05};
  EXPECT_FALSE(may_be_wide_lens(tracks, fit_of(perspective)));
  perspective.radial = {0.3, 0};  // outwards
  EXPECT_FALSE(may_be_wide_lens(tracks, fit_of(perspective)));
  perspective.radial = {-0.25, 0.05};
  EXPECT_TRUE(may_be_wide_lens(tracks, fit_of(perspective)));
  perspective.radial = {};
  perspective.scene.lenses[1] = Lens{290, 290, 320, 240};  // corners 54 degrees off the axis
  EXPECT_TRUE(may_be_wide_lens(tracks, fit_of(perspective)));
  perspective.image_posed = {0, 0};
  EXPECT_FALSE(may_be_wide_lens(tracks, fit_of(perspective)));
}

}  // namespace
}  // namespace raysfm
