#include "raysfm/ray_lenses/turn_lens.h"

#include <gtest/gtest.h>

#include <cmath>

#include "raysfm/core/random.h"
#include "raysfm/geometry/pose.h"

namespace raysfm {
namespace {

// A camera looks about from its place, and walks on after a part of the images. Points lie all round.
struct Turn {
  int images = 20, standing = 20;
  double radians = 1.2;  // of the turn from side to side; up and down a quarter of it
  double noise = 0.3;    // pixels
  int points = 2500;
  double step = 0.15;  // from image to image once it walks; points are 3 to 8 away
};

PointTracks tracks_of(const CameraModel& model, const Turn& turn) {
  Camera camera;
  camera.model = model;
  camera.width = 640, camera.height = 480;
  Rng rng(5);
  PointTracks tracks;
  tracks.image_count = turn.images;
  tracks.point_count = turn.points;
  tracks.image_size = {640, 480};
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i < tracks.point_count; ++i) {
    const Eigen::Vector3d direction(rng.normal(), rng.normal(), rng.normal());
    points.push_back(rng.uniform(3, 8) * direction.normalized());
  }
  for (int j = 0; j < turn.images; ++j) {
    const double s = double(j) / (turn.images - 1);
    const Eigen::Vector3d angles(0.25 * turn.radians * std::sin(5 * s), turn.radians * s,
                                 0.05 * std::sin(8 * s));
    const Eigen::Vector3d centre(turn.step * std::max(0, j - turn.standing), 0, 0);
    const Eigen::Quaterniond rotation = exp_so3(angles);
    for (int i = 0; i < tracks.point_count; ++i) {
      Eigen::Vector2d pixel;
      if (!camera.project(rotation * (points[i] - centre), &pixel)) continue;
      pixel += turn.noise * Eigen::Vector2d(rng.normal(), rng.normal());
      if (camera.contains(pixel)) tracks.add(j, i, pixel);
    }
  }
  return tracks;
}

double focal_of(const TurnLens& lens) {
  return lens.camera.pixels_per_radian();
}

TEST(LensOfTurn, FindsAFocalLengthAndWhatBendsLines) {
  const Radtan truth{520, 520, 326, 236, -0.2, 0.05, 0, 0};
  const auto lens = lens_of_turn(tracks_of(truth, {}), {});
  ASSERT_TRUE(lens);
  ASSERT_TRUE(std::holds_alternative<Radtan>(lens->camera.model));
  EXPECT_NEAR(focal_of(*lens), 520, 520 * 3 * lens->focal_sigma);
  EXPECT_LT(lens->focal_sigma, 0.005);
  const auto& found = std::get<Radtan>(lens->camera.model);
  EXPECT_NEAR(found.cx, 326, 3);
  EXPECT_NEAR(found.cy, 236, 3);
  EXPECT_NEAR(found.k1, -0.2, 0.03);
}

TEST(LensOfTurn, FindsShortAndLongLenses) {
  for (const double f : {260.0, 400.0, 900.0, 1600.0}) {
    const Radtan truth{f, f, 319.5, 239.5, 0, 0, 0, 0};
    const auto lens =
        lens_of_turn(tracks_of(truth, {.radians = 500 / f, .points = static_cast<int>(5 * f)}), {});
    ASSERT_TRUE(lens) << f;
    EXPECT_NEAR(focal_of(*lens), f, 3 * f * std::max(lens->focal_sigma, 0.001)) << f;
    EXPECT_LT(lens->focal_sigma, 0.05) << f;
  }
}

TEST(LensOfTurn, AFisheyeIsNone) {
  const KannalaBrandt truth{210, 210, 322, 238, 0.02, -0.004};
  const auto lens = lens_of_turn(tracks_of(truth, {}), {});
  ASSERT_TRUE(lens);
  ASSERT_TRUE(std::holds_alternative<KannalaBrandt>(lens->camera.model));
  EXPECT_NEAR(focal_of(*lens), 210, 210 * 3 * std::max(lens->focal_sigma, 0.001));
}

// Half of the images are taken on foot: what they say is left out.
TEST(LensOfTurn, LeavesOutWhereTheCameraMoves) {
  const Radtan truth{520, 520, 319.5, 239.5, 0, 0, 0, 0};
  const auto lens = lens_of_turn(tracks_of(truth, {.images = 40, .standing = 20, .radians = 2.4}), {});
  ASSERT_TRUE(lens);
  EXPECT_NEAR(focal_of(*lens), 520, 3);
}

// What a wall shows of a camera that goes along it, or up to it, is hardly a turn through any lens.
TEST(LensOfTurn, AWalkBeforeAWallTellsNoLens) {
  const Radtan truth{520, 520, 319.5, 239.5, 0, 0, 0, 0};
  for (const Eigen::Vector3d& step : {Eigen::Vector3d(0.15, 0, 0), {0, 0.1, 0.05}, {0, 0, 0.15}}) {
    Rng rng(7);
    PointTracks tracks;
    tracks.image_count = 20;
    tracks.point_count = 1500;
    tracks.image_size = {640, 480};
    std::vector<Eigen::Vector3d> points;
    for (int i = 0; i < tracks.point_count; ++i)
      points.emplace_back(rng.uniform(-8, 8), rng.uniform(-6, 6), 6);
    for (int j = 0; j < tracks.image_count; ++j) {
      for (int i = 0; i < tracks.point_count; ++i) {
        Eigen::Vector2d pixel;
        if (!truth.project(points[i] - j * step, &pixel)) continue;
        pixel += 0.3 * Eigen::Vector2d(rng.normal(), rng.normal());
        const bool is_seen = pixel.x() > 0 && pixel.y() > 0 && pixel.x() < 639 && pixel.y() < 479;
        if (is_seen) tracks.add(j, i, pixel);
      }
    }
    const auto lens = lens_of_turn(tracks, {.max_error_px = 3});
    EXPECT_TRUE(!lens || lens->focal_sigma > 0.02)
        << step.transpose() << ": " << focal_of(*lens) << " " << lens->focal_sigma << " " << lens->explained;
  }
}

TEST(LensOfTurn, AWalkIsNoTurn) {
  const Radtan truth{520, 520, 319.5, 239.5, 0, 0, 0, 0};
  EXPECT_FALSE(lens_of_turn(tracks_of(truth, {.standing = 0}), {}));
  EXPECT_FALSE(lens_of_turn(tracks_of(truth, {.standing = 0, .radians = 0.3}), {}));
}

// A turn of half a degree shows hardly more than a shift of the image.
TEST(LensOfTurn, ASmallTurnTellsLittle) {
  const Radtan truth{520, 520, 319.5, 239.5, 0, 0, 0, 0};
  const auto lens = lens_of_turn(tracks_of(truth, {.radians = 0.01}), {});
  EXPECT_TRUE(!lens || lens->focal_sigma > 0.05) << focal_of(*lens) << " " << lens->focal_sigma;
}

}  // namespace
}  // namespace raysfm
