#include "raysfm/projective/video_motion.h"

#include <gtest/gtest.h>

#include <numeric>

#include "raysfm/core/random.h"
#include "raysfm/geometry/rotation.h"
#include "raysfm/lenses/uncalibrated_scene.h"

namespace raysfm {
namespace {

struct Way {
  double translation = 0;  // of the whole, the points being 4 to 9 away
  double rotation = 0;     // radians
  bool plane = false;
  double k1 = 0;
};

// Tracks with 0.3 px of noise of 12 images of 640 x 480.
PointTracks film(const Way& way) {
  constexpr int kImages = 12, kPoints = 400;
  Rng rng(3);
  PointTracks tracks;
  tracks.image_count = kImages;
  tracks.point_count = kPoints;
  tracks.image_size = {640, 480};
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i < kPoints; ++i) {
    const double x = rng.uniform(-5, 5), y = rng.uniform(-4, 4);
    points.emplace_back(x, y, way.plane ? 6 + 0.4 * x : rng.uniform(4, 9));
  }
  for (int j = 0; j < kImages; ++j) {
    const double s = double(j) / (kImages - 1);
    const Eigen::Quaterniond rotation = exp_so3(Eigen::Vector3d(0.3, 1, 0.5).normalized() * way.rotation * s);
    const Eigen::Vector3d centre = way.translation * s * Eigen::Vector3d(0.8, 0.2, 0.5);
    const Lens lens{500, 500, 319.5, 239.5, 0};
    for (int i = 0; i < kPoints; ++i) {
      const Eigen::Vector3d x = rotation * (points[i] - centre);
      if (!(x.z() > 1)) continue;
      const Eigen::Vector2d straight = x.hnormalized();
      if (straight.squaredNorm() > 1) continue;  // beyond it the polynomial folds back
      const Eigen::Vector2d p = lens.pixel(straight * (1 + way.k1 * straight.squaredNorm())) +
                                0.3 * Eigen::Vector2d(rng.normal(), rng.normal());
      if (p.x() > 0 && p.y() > 0 && p.x() < 639 && p.y() < 479) tracks.add(j, i, p);
    }
  }
  return tracks;
}

// One film after the other, in other places.
PointTracks joined(PointTracks film, const PointTracks& next) {
  for (int k = 0; k < next.size(); ++k)
    film.add(film.image_count + next.image[k], film.point_count + next.point[k], next.pixel[k]);
  film.image_count += next.image_count;
  film.point_count += next.point_count;
  return film;
}

MotionShares shares_of_tracks(const PointTracks& tracks) {
  std::vector<int> images(tracks.image_count);
  std::iota(images.begin(), images.end(), 0);
  return motion_shares(tracks, images, 3.0, 0);
}

MotionShares shares_of(const Way& way) {
  return shares_of_tracks(film(way));
}

TEST(VideoMotion, GeneralMotionIsNotHopeless) {
  const MotionShares shares = shares_of({.translation = 2, .rotation = 0.3});
  EXPECT_GT(shares.pairs, 4);
  EXPECT_EQ(hopeless_motion(shares).name, "");
}

TEST(VideoMotion, RotationIsNamed) {
  EXPECT_EQ(hopeless_motion(shares_of({.translation = 0, .rotation = 0.4})).name, "pure rotation");
  // A hand does not turn a camera about its centre.
  EXPECT_EQ(hopeless_motion(shares_of({.translation = 0.02, .rotation = 0.4})).name, "pure rotation");
}

// A turn through a lens that bends lines is no homography, but near one, as is a turn with a step aside.
TEST(VideoMotion, RotationIsToldFromALittleParallax) {
  for (const double k1 : {-0.2, -0.1, 0.1}) {
    EXPECT_EQ(hopeless_motion(shares_of({.rotation = 0.4, .k1 = k1})).name, "pure rotation") << k1;
    EXPECT_EQ(hopeless_motion(shares_of({.translation = 0.2, .rotation = 0.4, .k1 = k1})).name, "") << k1;
  }
}

TEST(VideoMotion, PlaneIsNamed) {
  EXPECT_EQ(hopeless_motion(shares_of({.translation = 2, .rotation = 0.3, .plane = true})).name,
            "planar scene");
}

// A walk past a wall, and a room beyond it.
TEST(VideoMotion, AThirdOfAFilmIsEnough) {
  const PointTracks wall = film({.translation = 2, .rotation = 0.3, .plane = true});
  const PointTracks room = film({.translation = 2, .rotation = 0.3});
  EXPECT_EQ(hopeless_motion(shares_of_tracks(joined(wall, wall))).name, "planar scene");
  EXPECT_EQ(hopeless_motion(shares_of_tracks(joined(joined(wall, room), wall))).name, "");
  const PointTracks straight = film({.translation = 2, .rotation = 0});
  EXPECT_EQ(hopeless_motion(shares_of_tracks(joined(joined(straight, room), straight))).name, "");
}

TEST(VideoMotion, TranslationIsNamed) {
  EXPECT_EQ(hopeless_motion(shares_of({.translation = 2, .rotation = 0})).name, "pure translation");
}

TEST(VideoMotion, RestIsNamed) {
  EXPECT_EQ(hopeless_motion(shares_of({})).name, "no motion");
}

}  // namespace
}  // namespace raysfm
