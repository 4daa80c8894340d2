#include "raysfm/photos/photo_points.h"

#include <gtest/gtest.h>

namespace raysfm {
namespace {

// Photos with so many points each, which nothing is known of.
class Points : public PhotoFeatures {
 public:
  Points(int photos, int points) : pixels_(photos, std::vector<Eigen::Vector2d>(points)) {}
  Result<void> add(const GrayView& /*image*/, int /*max_features*/) override { return {}; }
  int photos() const override { return static_cast<int>(pixels_.size()); }
  const std::vector<Eigen::Vector2d>& pixels(int photo) const override { return pixels_[photo]; }
  std::vector<PhotoMatch> match(int, int, float) const override { return {}; }
  std::vector<Descriptor> codes(int) const override { return {}; }

 private:
  std::vector<std::vector<Eigen::Vector2d>> pixels_;
};

// Three photos of four points each: 0 to 3, 4 to 7, 8 to 11.
PhotoPoints three_photos() {
  PhotoPoints points;
  points.features = std::make_shared<Points>(3, 4);
  points.first = {0, 4, 8};
  points.rgb.resize(12);
  return points;
}

using Pairs = std::vector<std::pair<int, int>>;

TEST(JoinSamePoints, SetsAreTracksInTheOrderOfTheirFirstPoints) {
  PhotoPoints points = three_photos();
  join_same_points(Pairs{{0, 1}, {1, 2}}, std::vector<SamePoints>{{{2, 0}, {0, 3}}, {{3, 1}}}, &points);
  EXPECT_EQ(points.tracks, 2);
  EXPECT_EQ(points.track, (std::vector<int>{0, -1, 1, -1, 1, -1, -1, 0, -1, 0, -1, -1}));
}

TEST(JoinSamePoints, TwoPointsOfAPhotoAreNotOne) {
  PhotoPoints points = three_photos();
  join_same_points(Pairs{{0, 1}, {1, 2}, {0, 2}},
                   std::vector<SamePoints>{{{0, 0}, {3, 3}}, {{0, 0}}, {{1, 0}}}, &points);
  EXPECT_EQ(points.tracks, 1) << "points 0 and 1 of the first photo became one by way of the others";
  EXPECT_EQ(points.track, (std::vector<int>{-1, -1, -1, 0, -1, -1, -1, 0, -1, -1, -1, -1}));
}

TEST(JoinSamePoints, WhatWasOneStaysOne) {
  PhotoPoints before = three_photos();
  join_same_points(Pairs{{0, 1}}, std::vector<SamePoints>{{{1, 1}, {2, 2}, {3, 3}}}, &before);
  PhotoPoints now = before;
  // The first goes on in the third photo; the second and the third are two points of a photo that met there.
  join_same_points(Pairs{{0, 2}, {1, 2}}, std::vector<SamePoints>{{{1, 0}, {2, 1}}, {{3, 1}}}, &now);
  EXPECT_EQ(now.tracks, 1);
  EXPECT_EQ(now.track[1], 0);
  EXPECT_EQ(now.track[5], 0);
  EXPECT_EQ(now.track[8], 0);
  EXPECT_EQ(tracks_now(before, now), (std::vector<int>{0, -1, -1}));
}

}  // namespace
}  // namespace raysfm
