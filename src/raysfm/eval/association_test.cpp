#include "raysfm/eval/association.h"

#include <gtest/gtest.h>

#include <utility>
#include <vector>

namespace raysfm {
namespace {

std::vector<std::pair<int, int>> pairs(const std::vector<double>& estimate, const std::vector<double>& truth,
                                       double max_dt) {
  std::vector<std::pair<int, int>> result;
  for (const Match& match : associate(estimate, truth, max_dt))
    result.emplace_back(match.estimate, match.truth);
  return result;
}

using Pairs = std::vector<std::pair<int, int>>;

TEST(Association, PairsEqualTimes) {
  EXPECT_EQ(pairs({0, 1, 2}, {0, 1, 2}, 0), (Pairs{{0, 0}, {1, 1}, {2, 2}}));
}

TEST(Association, SkipsWhatIsMissingOnEitherSide) {
  EXPECT_EQ(pairs({1, 2, 5}, {0, 1, 2, 3, 4}, 0.1), (Pairs{{0, 1}, {1, 2}}));
}

TEST(Association, TakesTheNearestOfADenserTruth) {
  EXPECT_EQ(pairs({0.0, 1.0}, {-0.1, 0.02, 0.1, 0.96, 1.1}, 0.05), (Pairs{{0, 1}, {1, 3}}));
}

TEST(Association, NeverUsesAPoseTwice) {
  EXPECT_EQ(pairs({0.98, 1.01}, {1.0}, 0.05), (Pairs{{1, 0}}));
  EXPECT_EQ(pairs({1.0}, {0.98, 1.01}, 0.05), (Pairs{{0, 1}}));
}

TEST(Association, IncludesTheLimit) {
  EXPECT_EQ(pairs({0.5}, {1.0}, 0.5), (Pairs{{0, 0}}));
  EXPECT_TRUE(pairs({0.5}, {1.0}, 0.49).empty());
}

TEST(Association, EmptyListsHaveNoMatches) {
  EXPECT_TRUE(pairs({}, {1.0}, 1).empty());
  EXPECT_TRUE(pairs({1.0}, {}, 1).empty());
}

}  // namespace
}  // namespace raysfm
