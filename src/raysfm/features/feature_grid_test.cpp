#include "raysfm/features/feature_grid.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <vector>

#include "raysfm/core/random.h"

namespace raysfm {
namespace {

std::vector<int> found_in(const FeatureGrid& grid, const Eigen::Vector2f& center, float radius) {
  std::vector<int> found;
  grid.for_each_in(center, radius, [&](int i) { found.push_back(i); });
  std::sort(found.begin(), found.end());
  return found;
}

TEST(FeatureGrid, FindsWhatALoopOverAllFinds) {
  Rng rng(1);
  std::vector<Eigen::Vector2f> pixels;
  // Some lie outside the image.
  for (int i = 0; i < 800; ++i) pixels.emplace_back(rng.uniform(-40, 360), rng.uniform(-40, 280));
  FeatureGrid grid;
  grid.build(pixels, 320, 240);
  EXPECT_EQ(grid.size(), 800);
  for (int trial = 0; trial < 500; ++trial) {
    const Eigen::Vector2f center(rng.uniform(-60, 400), rng.uniform(-60, 300));
    const auto radius = static_cast<float>(rng.uniform(0, 80));
    std::vector<int> expected;
    for (int i = 0; i < 800; ++i) {
      if ((pixels[i] - center).squaredNorm() <= radius * radius) expected.push_back(i);
    }
    EXPECT_EQ(found_in(grid, center, radius), expected);
  }
}

TEST(FeatureGrid, RebuildsAndStaysCalm) {
  FeatureGrid grid;
  EXPECT_TRUE(found_in(grid, {0, 0}, 10).empty());
  const std::vector<Eigen::Vector2f> one{{5, 5}};
  grid.build(one, 20, 20);
  EXPECT_EQ(found_in(grid, {5, 6}, 1), std::vector<int>{0});
  EXPECT_TRUE(found_in(grid, {5, 6}, -1).empty());
  const float nan = std::numeric_limits<float>::quiet_NaN(), inf = std::numeric_limits<float>::infinity();
  EXPECT_TRUE(found_in(grid, {nan, 6}, 1).empty());
  EXPECT_TRUE(found_in(grid, {inf, 6}, 1).empty());
  EXPECT_TRUE(found_in(grid, {5, 6}, nan).empty());
  EXPECT_EQ(found_in(grid, {1e6f, 6}, 2e6f), std::vector<int>{0});
  grid.build({}, 20, 20);
  EXPECT_TRUE(found_in(grid, {5, 5}, 10).empty());
}

}  // namespace
}  // namespace raysfm
