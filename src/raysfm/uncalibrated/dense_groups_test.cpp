#include "raysfm/uncalibrated/dense_groups.h"

#include <gtest/gtest.h>

#include <algorithm>

namespace raysfm {
namespace {

// Images that share so many points with the next ones, in an order that is none.
PointTracks shuffled_ring(int images, int reach) {
  PointTracks tracks;
  tracks.image_count = images;
  tracks.point_count = 10 * images;
  tracks.image_size = {100, 100};
  for (int i = 0; i < tracks.point_count; ++i) {
    for (int step = 0; step <= reach; ++step) {
      const int place = (i / 10 + step) % images;
      tracks.add(place * 37 % images, i, {double(i % 100), double(place)});
    }
  }
  return tracks;
}

TEST(DenseGroups, AreNeighboursAndBeginApart) {
  constexpr int kImages = 100, kSize = 12;
  const auto groups = dense_groups(shuffled_ring(kImages, 4), kSize, 3);
  ASSERT_EQ(groups.size(), 3u);
  std::vector<uint8_t> taken(kImages, 0);
  for (const std::vector<int>& group : groups) {
    ASSERT_EQ(group.size(), size_t{kSize});
    EXPECT_TRUE(std::ranges::is_sorted(group));
    // Image 37 p mod 100 is at place p; 37 * 73 = 2701. On the ring the group is a stretch without a gap.
    std::vector<int> places;
    for (const int image : group) places.push_back(image * 73 % kImages);
    std::ranges::sort(places);
    int gaps = 0;
    for (size_t i = 0; i < places.size(); ++i) {
      gaps += (places[(i + 1) % places.size()] - places[i] + kImages) % kImages > 1;
    }
    EXPECT_EQ(gaps, 1);
    EXPECT_TRUE(std::ranges::any_of(group, [&](int image) { return !taken[image]; }));
    for (const int image : group) taken[image] = 1;
  }
}

TEST(DenseGroups, EndWhereNothingIsShared) {
  PointTracks tracks = shuffled_ring(6, 1);
  tracks.image_count = 9;  // three see nothing
  const auto groups = dense_groups(tracks, 20, 5);
  ASSERT_EQ(groups.size(), 1u);
  EXPECT_EQ(groups[0], (std::vector<int>{0, 1, 2, 3, 4, 5}));
  EXPECT_TRUE(dense_groups(PointTracks{}, 20, 5).empty());
}

}  // namespace
}  // namespace raysfm
