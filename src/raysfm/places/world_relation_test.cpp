#include "raysfm/places/world_relation.h"

#include <gtest/gtest.h>

#include <cmath>

#include "raysfm/core/random.h"
#include "raysfm/places/map_fusion.h"
#include "support/described_map.h"

namespace raysfm {
namespace {

using testing_support::degrees_between;
using testing_support::described_map;
using testing_support::PanelWorld;
using testing_support::TrueMap;

// One place filmed twice: `there` is the truth; the other map has its own origin, directions and unit.
class WorldRelationTest : public testing::Test {
 protected:
  static constexpr int kHere = 4, kThere = 1;

  void recognise() {
    seen_ = described_corners(here_.map.keyframes[kHere]);
    const auto place = PlaceMatcher(there_.rig).recognise(seen_, there_.map, kThere, 1, 2);
    ASSERT_TRUE(place);
    place_ = *place;
  }
  void move_here(double scale) {
    here_from_there_ = {scale, exp_so3({0.3, -0.8, 0.2}), {1, -2, 3}};
    transform_map(here_from_there_, &here_.map);
    recognise();
  }
  std::optional<WorldRelation> relate(bool same_scale = false) const {
    return relate_worlds(there_.rig, here_.map, kHere, seen_, there_.map, place_, same_scale);
  }

  TrueMap there_ = described_map(PanelWorld(7), 3), here_ = described_map(PanelWorld(7), 5);
  Similarity3 here_from_there_;
  DescribedCorners seen_;
  RecognisedPlace place_;
};

TEST_F(WorldRelationTest, FindsTheSimilarity) {
  for (const double scale : {0.2, 1.0, 7.0}) {
    here_ = described_map(PanelWorld(7), 5);
    move_here(scale);
    const std::optional<WorldRelation> relation = relate();
    ASSERT_TRUE(relation) << scale;
    const Similarity3 expected = inverse(here_from_there_);
    const Similarity3& found = relation->there_from_here;
    EXPECT_NEAR(found.scale * scale, 1, 0.01);
    EXPECT_LT(degrees_between(found.rotation, expected.rotation), 0.3);
    // Where the camera is, in metres.
    const Eigen::Vector3d center = here_.map.keyframes[kHere].rig_from_world.inverse().translation;
    EXPECT_LT((found * center - expected * center).norm(), 0.02);
    EXPECT_GT(relation->log_scale_sigma, 0);
    EXPECT_LT(relation->log_scale_sigma, 0.02);
    EXPECT_LT(std::abs(std::log(found.scale * scale)), 5 * relation->log_scale_sigma + 1e-3);

    ASSERT_GT(relation->points.size(), 60u);
    int near = 0;
    for (const SamePoint& p : relation->points) {
      near +=
          (expected * here_.map.tracks[p.here].position - there_.map.tracks[p.there].position).norm() < 0.1;
    }
    EXPECT_GT(near, 0.9 * static_cast<double>(relation->points.size()));
  }
}

TEST_F(WorldRelationTest, AScaleThatIsKnownMustAgree) {
  move_here(1);
  const auto same = relate(true);
  ASSERT_TRUE(same);
  EXPECT_EQ(same->there_from_here.scale, 1);
  EXPECT_EQ(same->log_scale_sigma, 0);
  for (const double scale : {0.8, 1.25}) {
    here_ = described_map(PanelWorld(7), 5);
    move_here(scale);
    EXPECT_TRUE(relate(false)) << scale;
    EXPECT_FALSE(relate(true)) << scale;
  }
}

// Distances with normal errors: the scale is off by as much as is said of it.
TEST_F(WorldRelationTest, TheScaleIsAsSureAsIsSaid) {
  constexpr int kTrials = 300;
  move_here(2);
  const Map exact = here_.map;
  const Rigid3& rig_from_world = exact.keyframes[kHere].rig_from_world;
  const auto right = relate();
  ASSERT_TRUE(right);
  Rng rng(11);
  double squares = 0, said = 0;
  for (int trial = 0; trial < kTrials; ++trial) {
    for (size_t t = 0; t < exact.tracks.size(); ++t) {
      here_.map.tracks[t].position = rig_from_world.inverse() * (std::exp(0.08 * rng.normal()) *
                                                                 (rig_from_world * exact.tracks[t].position));
    }
    const auto relation = relate();
    ASSERT_TRUE(relation);
    squares +=
        std::pow(std::log(relation->there_from_here.scale / right->there_from_here.scale), 2) / kTrials;
    said += std::pow(relation->log_scale_sigma, 2) / kTrials;
  }
  EXPECT_GT(squares / said, 0.7);
  EXPECT_LT(squares / said, 1.4);
}

// A map of something else behind the same picture.
TEST_F(WorldRelationTest, DistancesOfNoOneScaleAreRefused) {
  move_here(2);
  ASSERT_TRUE(relate());
  Rng rng(4);
  const Rigid3& rig_from_world = here_.map.keyframes[kHere].rig_from_world;
  for (Track& t : here_.map.tracks) {
    t.position = rig_from_world.inverse() * (std::exp(0.5 * rng.normal()) * (rig_from_world * t.position));
  }
  EXPECT_FALSE(relate());
}

// At the right distances, but not where the place sees them.
TEST_F(WorldRelationTest, PointsElsewhereAreRefused) {
  move_here(2);
  const Rigid3& rig_from_world = here_.map.keyframes[kHere].rig_from_world;
  const Eigen::Quaterniond turn = exp_so3({0, 0.15, 0});
  for (Track& t : here_.map.tracks) {
    t.position = rig_from_world.inverse() * (turn * (rig_from_world * t.position));
  }
  EXPECT_FALSE(relate());
}

TEST_F(WorldRelationTest, PointsWithoutAPositionSayNothing) {
  move_here(2);
  const auto all = relate();
  ASSERT_TRUE(all);
  for (size_t t = 0; t < here_.map.tracks.size(); t += 2) here_.map.tracks[t].triangulated = false;
  const auto half = relate();
  ASSERT_TRUE(half);
  EXPECT_LT(half->points.size(), all->points.size());
  for (const SamePoint& p : half->points) EXPECT_EQ(p.here % 2, 1);
  int left = 8;  // too few
  for (const SamePoint& p : half->points) here_.map.tracks[p.here].triangulated = left-- > 0;
  EXPECT_FALSE(relate());
}

TEST_F(WorldRelationTest, CornersHaveTheirTracks) {
  MapKeyFrame& k = here_.map.keyframes[kHere];
  const int gone = k.described[3];
  k.tracks[gone] = -1;
  const DescribedCorners corners = described_corners(k);
  ASSERT_EQ(corners.corners.size(), k.described.size() - 1);
  ASSERT_EQ(corners.descriptors.size(), corners.corners.size());
  for (size_t i = 0; i < corners.corners.size(); ++i) {
    const size_t described = i < 3 ? i : i + 1;
    const int f = k.described[described];
    EXPECT_EQ(corners.corners[i].track, k.tracks[f]);
    EXPECT_EQ(corners.corners[i].pixel, k.pixels[f]);
    EXPECT_EQ(corners.descriptors[i].bits, k.descriptors[described].bits);
  }
}

}  // namespace
}  // namespace raysfm
