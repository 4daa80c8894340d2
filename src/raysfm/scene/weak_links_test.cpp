#include "raysfm/scene/weak_links.h"

#include <gtest/gtest.h>

#include <algorithm>

namespace raysfm {
namespace {

// Key frames at every tenth frame; `sights` names for each point the key frames that see it, so many times
// over.
struct Sight {
  std::vector<int> keyframes;
  int points;
};

Reconstruction world(int keyframes, const std::vector<Sight>& sights) {
  Reconstruction r;
  r.segments.resize(1);
  r.frames.resize(10 * keyframes);
  for (PosedFrame& frame : r.frames) frame.segment = 0;
  for (int k = 0; k < keyframes; ++k) {
    KeyFrame& keyframe = r.keyframes.emplace_back();
    keyframe.frame = 10 * k;
    keyframe.first_observation = static_cast<int>(r.observations.size());
    int point = 0;
    for (const Sight& sight : sights) {
      for (int i = 0; i < sight.points; ++i, ++point) {
        if (std::ranges::count(sight.keyframes, k)) r.observations.emplace_back().point = point;
      }
    }
    keyframe.last_observation = static_cast<int>(r.observations.size());
    r.points.resize(point);
  }
  return r;
}

// Two halves of five key frames that so many points hold together.
Reconstruction two_halves(int held_by) {
  return world(10, {{{0, 1, 2, 3, 4}, 500}, {{5, 6, 7, 8, 9}, 500}, {{2, 3, 4, 5, 6, 7}, held_by}});
}

TEST(WeakLinks, FewPointsAreToldWithTheirFrames) {
  const std::vector<WeakLink> links = weak_links(two_halves(7));
  ASSERT_EQ(links.size(), 1u);
  EXPECT_LE(links[0].first, 40);
  EXPECT_GE(links[0].last, 50);
  EXPECT_EQ(links[0].points, 7);
}

TEST(WeakLinks, ManyAreNot) {
  EXPECT_TRUE(weak_links(two_halves(60)).empty());
}

// One sight tells where a point is seen, not how far it is.
TEST(WeakLinks, PointsSeenOnceOnOneSideDoNotCount) {
  const Reconstruction r = world(10, {{{0, 1, 2, 3, 4}, 500}, {{5, 6, 7, 8, 9}, 500}, {{2, 3, 4, 5}, 300}});
  const std::vector<WeakLink> links = weak_links(r);
  ASSERT_EQ(links.size(), 1u);
  EXPECT_EQ(links[0].points, 0);
}

TEST(WeakLinks, ARigKnowsItsScale) {
  Reconstruction r = two_halves(7);
  r.segments[0].metric_scale = true;
  EXPECT_TRUE(weak_links(r).empty());
}

// What is poor all over is no weak place.
TEST(WeakLinks, FewPointsEverywhereAreUsual) {
  EXPECT_TRUE(weak_links(world(8, {{{0, 1, 2, 3, 4, 5, 6, 7}, 20}})).empty());
}

TEST(WeakLinks, APlaceSeenAgainHoldsWhatIsBetween) {
  EXPECT_TRUE(weak_links(world(10, {{{0, 1, 2, 3, 4}, 500},
                                    {{5, 6, 7, 8, 9}, 500},
                                    {{0, 1, 8, 9}, 100},
                                    {{2, 3, 4, 5, 6, 7}, 7}}))
                  .empty());
}

TEST(WeakLinks, WorldsOfFewKeyFramesHaveNone) {
  EXPECT_TRUE(weak_links({}).empty());
  EXPECT_TRUE(weak_links(world(3, {{{0, 1, 2}, 5}})).empty());
}

}  // namespace
}  // namespace raysfm
