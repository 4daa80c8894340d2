#include "raysfm/places/described.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "raysfm/core/random.h"
#include "support/described_map.h"

namespace raysfm {
namespace {

// A key frame with many features, a third of them seen by two more.
class DescribedTest : public testing::Test {
 protected:
  void SetUp() override {
    const CameraView& view = truth_.views[0].view->cameras[0];
    map_.keyframes.resize(3);
    Rng rng(3);
    for (int i = 0; i < 1800; ++i) {
      const Eigen::Vector2f pixel(rng.uniform(20, view.width - 20), rng.uniform(20, view.height - 20));
      const int track = map_.new_track();
      map_.tracks[track].triangulated = map_.tracks[track].had_position = true;
      for (int k = 0; k < (i % 3 == 0 ? 3 : 1); ++k) {
        map_.observe(track, k, map_.keyframes[k].add(0, pixel, 0, track));
      }
    }
  }
  const MapKeyFrame& described() {
    describe_keyframe(map_, *truth_.views[0].view, describer_, &map_.keyframes[0]);
    return map_.keyframes[0];
  }

  testing_support::TrueMap truth_ = testing_support::described_map(testing_support::PanelWorld(7), 1);
  Map map_;
  Describer describer_;
};

TEST_F(DescribedTest, WhatIsSeenMostOftenComesFirst) {
  const MapKeyFrame& k = described();
  ASSERT_GT(k.described.size(), kDescribedPoints * 0.9);
  ASSERT_LE(k.described.size(), kDescribedPoints);
  const auto often = std::ranges::count_if(
      k.described, [&](int f) { return map_.tracks[k.tracks[f]].observations.size() == 3; });
  EXPECT_GT(static_cast<double>(often), 0.6 * static_cast<double>(k.described.size()));
  EXPECT_TRUE(std::ranges::is_sorted(k.described));
}

TEST_F(DescribedTest, OnlyPointsThatAgreeAndHaveAPosition) {
  MapKeyFrame& k = map_.keyframes[0];
  for (int f = 0; f < k.size(); f += 2) k.inliers[f] = 0;
  for (int f = 1; f < k.size(); f += 4) map_.tracks[k.tracks[f]].triangulated = false;
  described();
  ASSERT_GT(k.described.size(), 100u);
  for (const int f : k.described) EXPECT_EQ(f % 4, 3);
}

}  // namespace
}  // namespace raysfm
