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

}  // namespace
}  // namespace raysfm
