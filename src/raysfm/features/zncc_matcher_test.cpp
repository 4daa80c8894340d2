#include "raysfm/features/zncc_matcher.h"

#include <gtest/gtest.h>

#include <limits>

#include "support/instruction_sets.h"
#include "support/texture.h"

namespace raysfm {
namespace {

using testing_support::for_each_instruction_set;
using testing_support::render;
using testing_support::Texture;

// Two noisy views of one texture with pixels scattered over both.
struct Scene {
  std::vector<Eigen::Vector2f> query_pixels, train_pixels;
  PatchSet query, train;
  FeatureGrid grid;

  explicit Scene(int count) {
    const Texture texture(1, 5, 30, 30);
    const auto shifted = [](const Eigen::Vector2d& p) -> Eigen::Vector2d {
      return p + Eigen::Vector2d(3, -2);
    };
    const GrayImage a = render(texture, 320, 240, shifted, 1, 0, 3, 1);
    const GrayImage b = render(
        texture, 320, 240, [](const Eigen::Vector2d& p) { return p; }, 1, 0, 3, 2);
    Rng rng(5);
    for (int i = 0; i < count; ++i) {
      query_pixels.emplace_back(rng.uniform(8, 310), rng.uniform(8, 230));
      train_pixels.push_back(query_pixels.back() + Eigen::Vector2f(3, -2));
    }
    std::reverse(train_pixels.begin(), train_pixels.end());
    extract_patches(a.view(), query_pixels, &query);
    extract_patches(b.view(), train_pixels, &train);
    grid.build(train_pixels, 320, 240);
  }

  std::vector<ZnccMatch> match(float radius, const ZnccOptions& options = {}) const {
    const std::vector<float> radii(query_pixels.size(), radius);
    std::vector<ZnccMatch> matches;
    ZnccMatcher().match(query, query_pixels, radii, train, train_pixels, grid, options, &matches);
    return matches;
  }

  // Best partner in the other set by a loop over all, and its score and the second's.
  struct Best {
    int index = -1;
    float score = 0, second = 0;
  };
  Best best(bool of_query, int i, float radius) const {
    Best best;
    const int others = of_query ? train.size() : query.size();
    for (int j = 0; j < others; ++j) {
      const int q = of_query ? i : j, t = of_query ? j : i;
      if ((query_pixels[q] - train_pixels[t]).norm() > radius) continue;
      const float score = zncc(query, q, train, t);
      if (score > best.score) {
        best.second = best.score;
        best.index = j;
        best.score = score;
      } else {
        best.second = std::max(best.second, score);
      }
    }
    return best;
  }
};

TEST(ZnccMatcher, AgreesWithALoopOverAllPairs) {
  const Scene scene(400);
  for (const float radius : {6.0f, 25.0f, 400.0f}) {
    for (const float ratio : {1.0f, 0.6f}) {
      const ZnccOptions options{0.5f, ratio};
      std::vector<ZnccMatch> expected;
      for (int q = 0; q < 400; ++q) {
        const auto best = scene.best(true, q, radius);
        if (best.index < 0 || best.score < 0.5f || scene.best(false, best.index, radius).index != q) continue;
        if (1 - best.score > ratio * (1 - best.second)) continue;
        expected.push_back({q, best.index, best.score});
      }
      ASSERT_GT(expected.size(), 150u);
      for_each_instruction_set([&](const char* name) {
        const auto matches = scene.match(radius, options);
        ASSERT_EQ(matches.size(), expected.size()) << name << ' ' << radius << ' ' << ratio;
        for (size_t i = 0; i < matches.size(); ++i) {
          EXPECT_EQ(matches[i].query, expected[i].query);
          EXPECT_EQ(matches[i].train, expected[i].train);
          EXPECT_NEAR(matches[i].zncc, expected[i].zncc, 1e-6);
        }
      });
    }
  }
}

TEST(ZnccMatcher, FindsTheTruePartners) {
  const Scene scene(400);
  int right = 0;
  const auto matches = scene.match(20);
  for (const ZnccMatch& m : matches) right += m.train == 399 - m.query;
  EXPECT_GT(matches.size(), 380u);
  EXPECT_GT(right, 0.99 * static_cast<double>(matches.size()));
}

TEST(ZnccMatcher, EachIsMatchedOnce) {
  const Scene scene(400);
  std::vector<int> queries(400), trains(400);
  for (const ZnccMatch& m : scene.match(50, {0.1f, 1})) {
    EXPECT_EQ(queries[m.query]++, 0);
    EXPECT_EQ(trains[m.train]++, 0);
  }
}

TEST(ZnccMatcher, QueriesWithoutAPlaceTakeNoPart) {
  const Scene scene(50);
  const float nan = std::numeric_limits<float>::quiet_NaN();
  std::vector<Eigen::Vector2f> predicted = scene.query_pixels;
  std::vector<float> radii(50, 20);
  radii[0] = 0;
  radii[1] = nan;
  radii[2] = -5;
  predicted[3] = {nan, 5};
  predicted[4] = {-1e9f, 1e9f};
  std::vector<ZnccMatch> matches;
  ZnccMatcher matcher;
  matcher.match(scene.query, predicted, radii, scene.train, scene.train_pixels, scene.grid, {}, &matches);
  EXPECT_GT(matches.size(), 35u);
  for (const ZnccMatch& m : matches) EXPECT_GT(m.query, 4);
  PatchSet none;
  matcher.match(none, {}, {}, scene.train, scene.train_pixels, scene.grid, {}, &matches);
  EXPECT_TRUE(matches.empty());
  FeatureGrid empty;
  empty.build({}, 320, 240);
  matcher.match(scene.query, scene.query_pixels, radii, none, {}, empty, {}, &matches);
  EXPECT_TRUE(matches.empty());
}

}  // namespace
}  // namespace raysfm
