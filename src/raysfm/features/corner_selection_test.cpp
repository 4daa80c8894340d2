#include "raysfm/features/corner_selection.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <numeric>
#include <vector>

#include "raysfm/core/random.h"

namespace raysfm {
namespace {

std::vector<Corner> random_corners(int count, int width, int height) {
  Rng rng(1);
  std::vector<Corner> corners(count);
  for (Corner& c : corners) {
    c.x = static_cast<float>(rng.uniform(0, width));
    c.y = static_cast<float>(rng.uniform(0, height));
    c.score = static_cast<float>(rng.uniform(1, 100));
  }
  return corners;
}

TEST(CornerSelection, WithoutSpreadKeepsTheStrongestInTheirOrder) {
  const auto corners = random_corners(1000, 640, 480);
  auto sorted = corners;
  std::nth_element(sorted.begin(), sorted.begin() + 200, sorted.end(),
                   [](const Corner& a, const Corner& b) { return a.score > b.score; });
  std::vector<float> expected, kept;
  for (const Corner& c : corners) {
    if (c.score > sorted[200].score) expected.push_back(c.score);
  }
  auto chosen = corners;
  CornerSelector().select(640, 480, 200, {.least = 0}, &chosen);
  for (const Corner& c : chosen) kept.push_back(c.score);
  EXPECT_EQ(kept, expected);
}

TEST(CornerSelection, ASingleFaintCornerInItsCellIsKept) {
  auto corners = random_corners(1000, 300, 480);
  corners.push_back({620, 240, 0.5f});
  CornerSelector().select(640, 480, 200, {.least = 0.5f}, &corners);
  EXPECT_EQ(corners.size(), 200u);
  EXPECT_EQ(corners.back().x, 620);
}

TEST(CornerSelection, EqualScoresGoToTheEarlier) {
  std::vector<Corner> corners(50, Corner{10, 10, 3});
  for (int i = 0; i < 50; ++i) corners[i].x = static_cast<float>(i);
  CornerSelector().select(100, 100, 20, {.least = 0}, &corners);
  ASSERT_EQ(corners.size(), 20u);
  for (int i = 0; i < 20; ++i) EXPECT_EQ(corners[i].x, i);
}

// Scores of all sizes, many of them equal, none among them.
TEST(CornerSelection, OfManyThoseAreChosenThatASortPutsFirst) {
  Rng rng(2);
  auto corners = random_corners(3000, 640, 480);
  for (Corner& c : corners) c.score = std::exp2(static_cast<float>(std::floor(rng.uniform(-60, 60)) / 4));
  for (size_t i = 0; i < corners.size(); i += 7) corners[i].score = 0;
  std::vector<int> order(corners.size());
  std::iota(order.begin(), order.end(), 0);
  std::ranges::stable_sort(order, std::greater<>(), [&](int i) { return corners[i].score; });
  for (const int count : {1, 57, 700, 1500, 2900, 2999}) {
    std::vector<int> best(order.begin(), order.begin() + count);
    std::ranges::sort(best);
    auto chosen = corners;
    CornerSelector().select(640, 480, count, {.least = 0}, &chosen);
    ASSERT_EQ(static_cast<int>(chosen.size()), count);
    for (int i = 0; i < count; ++i) EXPECT_EQ(chosen[i].x, corners[best[i]].x) << count;
  }
}

// A tenth of the image has corners a thousand times stronger than those of the rest, and twice as many as are
// wanted; the lower half has none.
TEST(CornerSelection, NoCellClaimsMoreThanItsMostWhileOthersHaveCorners) {
  std::vector<Corner> corners;
  Rng rng(3);
  const auto add = [&](int count, double x0, double x1, double score) {
    for (int i = 0; i < count; ++i) {
      corners.push_back({static_cast<float>(rng.uniform(x0, x1)), static_cast<float>(rng.uniform(0, 240)),
                         static_cast<float>(score * rng.uniform(1, 2))});
    }
  };
  add(2000, 0, 128, 1000);
  add(2000, 128, 640, 1);
  const auto strong = [&](const CellShares& shares, int wanted) {
    auto chosen = corners;
    CornerSelector().select(640, 480, wanted, shares, &chosen);
    EXPECT_EQ(static_cast<int>(chosen.size()), wanted);
    return std::ranges::count_if(chosen, [](const Corner& c) { return c.x < 128; });
  };
  EXPECT_GT(strong({.least = 0.4f}, 1000), 700);
  // A fifth of where there are corners.
  EXPECT_NEAR(strong({.least = 0.4f, .most = 1.5f}, 1000), 200, 30);
  EXPECT_NEAR(strong({.least = 0.4f, .most = 3}, 1000), 300, 40);
  // Where the others have no more.
  EXPECT_NEAR(strong({.least = 0.4f, .most = 1.5f}, 3500), 1550, 100);
}

TEST(CornerSelection, FewerThanWantedAllStay) {
  auto corners = random_corners(20, 640, 480);
  CornerSelector().select(640, 480, 20, {.least = 0.5f}, &corners);
  EXPECT_EQ(corners.size(), 20u);
  CornerSelector().select(640, 480, 0, {.least = 0.5f}, &corners);
  EXPECT_TRUE(corners.empty());
}

}  // namespace
}  // namespace raysfm
