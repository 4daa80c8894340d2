#include "raysfm/lenses/point_tracks.h"

#include <gtest/gtest.h>

namespace raysfm {
namespace {

TEST(RenumberPoints, TheFirstThatHasAPositionCounts) {
  const auto at = [](double x) { return Eigen::Vector3d(x, 0, 0); };
  std::vector<Eigen::Vector3d> points = {at(1), at(2), at(3), at(4)};
  std::vector<uint8_t> placed = {0, 1, 1, 1};
  const std::vector<int> number = {2, 2, 2, -1};
  renumber_points(number, 3, &points, &placed);
  EXPECT_EQ(placed, (std::vector<uint8_t>{0, 0, 1}));
  ASSERT_EQ(points.size(), 3u);
  EXPECT_EQ(points[2], at(2));
}

TEST(SeenBy, KeepsWhatEnoughOfTheImagesSee) {
  PointTracks tracks;
  tracks.image_count = tracks.point_count = 3;
  for (int image = 0; image < 3; ++image) {
    for (int point = 0; point < 3; ++point) {
      if (image != 2 || point != 1) tracks.add(image, point, {image, point});
    }
  }
  const std::vector<uint8_t> images = {1, 0, 1};
  EXPECT_EQ(seen_by(tracks, images, 1, nullptr).size(), 5);
  std::vector<int> observations;
  const PointTracks seen = seen_by(tracks, images, 2, &observations);
  EXPECT_EQ(seen.point, (std::vector<int>{0, 2, 0, 2}));
  EXPECT_EQ(seen.image, (std::vector<int>{0, 0, 2, 2}));
  EXPECT_EQ(observations, (std::vector<int>{0, 2, 6, 7}));
  EXPECT_EQ(seen.pixel[3], Eigen::Vector2d(2, 2));
  EXPECT_EQ(seen.image_count, 3);
}

}  // namespace
}  // namespace raysfm
