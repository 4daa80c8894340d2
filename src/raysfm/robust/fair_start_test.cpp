#include "raysfm/robust/fair_start.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

#include "support/pose_errors.h"
#include "support/rig_test_scenes.h"

namespace raysfm {
namespace {

using namespace rig_scenes;
using testing_support::kDegree;

// A scene and what moves before it; each with so many points in so many parts of the image.
struct TwoBodies {
  Scene still, moving;
  std::vector<ObservedRay> rays;
  std::vector<int> points, views, cameras, places;

  RigMatches matches() const { return {static_cast<int>(places.size()), rays, points, views, cameras}; }
};

struct Body {
  int points = 0, places = 0;
  double outliers = 0;
};

TwoBodies two_bodies(Kind kind, const Body& still, const Body& moving, uint64_t seed) {
  TwoBodies both;
  Rng rng(seed, 5);
  both.still = make_scene({kind, Motion::kForward, still.points, 0.5, still.outliers}, rng);
  both.moving = make_scene({kind, Motion::kSideways, moving.points, 0.5, moving.outliers}, rng);
  const auto add = [&](const Scene& scene, int places, int first_place) {
    const int first = static_cast<int>(both.places.size());
    for (size_t k = 0; k < scene.rays.size(); ++k) {
      both.rays.push_back(scene.rays[k]);
      both.points.push_back(first + scene.points[k]);
      both.views.push_back(scene.views[k]);
      both.cameras.push_back(scene.cameras[k]);
    }
    for (int i = 0; i < static_cast<int>(scene.points_in_rig0.size()); ++i)
      both.places.push_back(first_place + i % places);
  };
  add(both.moving, moving.places, 0);
  add(both.still, still.places, moving.places);
  return both;
}

double wrong_by(const Scene& scene, const GenericStart& start) {
  const MotionError error = motion_error(scene, start.rig1_from_rig0, start.rig2_from_rig0);
  return std::max(error.rotation / (0.3 * kDegree), error.direction / (3 * kDegree));
}

GenericStartOptions options_of(uint64_t seed) {
  return {.min_inliers = 50, .min_inlier_ratio = 0.55, .seed = seed};
}

TEST(FairStart, WhatCoversMoreOfTheImageIsTheRigsMotion) {
  for (const Kind kind : {Kind::kCentral, Kind::kRing3}) {
    for (uint64_t seed = 0; seed < 3; ++seed) {
      const TwoBodies both = two_bodies(kind, {120, 100}, {260, 20}, seed);
      const GenericStart unfair = start_generic(both.matches(), options_of(seed));
      ASSERT_TRUE(unfair.ok()) << describe(unfair);
      EXPECT_LT(wrong_by(both.moving, unfair), 1);
      const FairStart fair = start_fairly(both.matches(), both.places, options_of(seed));
      ASSERT_TRUE(fair.start.ok()) << describe(fair.start);
      EXPECT_LT(wrong_by(both.still, fair.start), 1);
      EXPECT_GT(fair.rival_share, 0.7);
      ASSERT_EQ(fair.start.inlier.size(), 380u);
      EXPECT_LT(std::count(fair.start.inlier.begin(), fair.start.inlier.begin() + 260, 1), 26);
      EXPECT_GT(std::count(fair.start.inlier.begin() + 260, fair.start.inlier.end(), 1), 110);
      for (int i = 260; i < 380; ++i) {
        if (kind != Kind::kRing3 || fair.start.inlier[i] == 0) continue;
        const Eigen::Vector3d& truth = both.still.points_in_rig0[i - 260];
        EXPECT_LT(fair.start.points_in_rig0[i].normalized().cross(truth.normalized()).norm(), 0.1);
      }
    }
  }
}

TEST(FairStart, WhatMovesBesideDoesNotCountAgainstIt) {
  for (uint64_t seed = 0; seed < 3; ++seed) {
    const TwoBodies both = two_bodies(Kind::kCentral, {160, 100, 0.25}, {110, 20}, seed);
    const GenericStart unfair = start_generic(both.matches(), options_of(seed));
    EXPECT_EQ(unfair.problem, StartProblem::kTooFewInliers) << describe(unfair);
    const FairStart fair = start_fairly(both.matches(), both.places, options_of(seed));
    ASSERT_TRUE(fair.start.ok()) << describe(fair.start);
    EXPECT_LT(wrong_by(both.still, fair.start), 1);
    EXPECT_NEAR(fair.rival_share, 0.17, 0.05);
  }
}

TEST(FairStart, OfTwoThatCoverTheSameNeitherIs) {
  const TwoBodies both = two_bodies(Kind::kCentral, {100, 60}, {200, 60}, 1);
  const FairStart fair = start_fairly(both.matches(), both.places, options_of(1));
  EXPECT_EQ(fair.start.problem, StartProblem::kTwoMotions);
  EXPECT_NE(describe(fair.start).find("two motions"), std::string::npos);
}

TEST(FairStart, WhatIsNoRigidMotionStaysNone) {
  const TwoBodies both = two_bodies(Kind::kCentral, {150, 100, 1}, {150, 20, 1}, 2);
  const FairStart fair = start_fairly(both.matches(), both.places, options_of(2));
  EXPECT_FALSE(fair.start.ok());
  EXPECT_LT(fair.rival_share, 0.15);
}

TEST(FairStart, WhereAllAgreeItIsTheGenericOne) {
  Rng rng(3, 6);
  const Scene scene = make_scene({Kind::kRing3, Motion::kRotation, 200, 0.5, 0.1}, rng);
  const std::vector<int> places(200, 0);
  const GenericStart start = start_generic(scene.matches(), {});
  const FairStart fair = start_fairly(scene.matches(), places, {});
  ASSERT_TRUE(start.ok());
  EXPECT_EQ(fair.rival_share, 0);
  EXPECT_EQ(fair.start.inlier, start.inlier);
  EXPECT_EQ(fair.start.points_in_rig0, start.points_in_rig0);
  EXPECT_TRUE(fair.start.rig2_from_rig0.translation == start.rig2_from_rig0.translation);
}

}  // namespace
}  // namespace raysfm
