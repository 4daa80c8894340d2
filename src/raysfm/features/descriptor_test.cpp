#include "raysfm/features/descriptor.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <numbers>

#include "raysfm/core/random.h"
#include "support/instruction_sets.h"
#include "support/texture.h"

namespace raysfm {
namespace {

using testing_support::render;
using testing_support::Texture;

std::vector<Descriptor> random_descriptors(int count, uint64_t seed) {
  Rng rng(seed);
  std::vector<Descriptor> out(count);
  for (Descriptor& d : out) {
    for (uint64_t& word : d.bits) word = rng.next();
  }
  return out;
}

Descriptor flipped(Descriptor d, int flips) {
  for (int i = 0; i < flips; ++i) d.bits[i % 4] ^= uint64_t{1} << (7 * i % 64);
  return d;
}

// The definition, in plain loops.
std::vector<DescriptorMatch> match_plainly(std::span<const Descriptor> query,
                                           std::span<const Descriptor> train, float max_ratio) {
  const auto nearest = [](const Descriptor& d, std::span<const Descriptor> others, int without) {
    int best = -1;
    for (int i = 0; i < static_cast<int>(others.size()); ++i) {
      if (i != without && (best < 0 || distance(d, others[i]) < distance(d, others[best]))) best = i;
    }
    return best;
  };
  std::vector<DescriptorMatch> out;
  for (int q = 0; q < static_cast<int>(query.size()); ++q) {
    const int t = nearest(query[q], train, -1);
    if (nearest(train[t], query, -1) != q) continue;
    const int best = distance(query[q], train[t]);
    const int second = nearest(query[q], train, t);
    if (second >= 0 &&
        static_cast<float>(best) >= max_ratio * static_cast<float>(distance(query[q], train[second]))) {
      continue;
    }
    out.push_back({q, t, best});
  }
  return out;
}

TEST(Descriptor, MatchesAreThoseOfTheDefinitionOnEveryInstructionSet) {
  for (const int size : {1, 2, 7, 8, 9, 150}) {
    const std::vector<Descriptor> train = random_descriptors(size, 1);
    std::vector<Descriptor> query = random_descriptors(40, 2);
    for (int i = 0; i < 40; i += 2) query[i] = flipped(train[3 * i % size], i);
    for (const float ratio : {0.8f, 1.0f}) {
      const std::vector<DescriptorMatch> expected = match_plainly(query, train, ratio);
      ASSERT_FALSE(expected.empty());
      testing_support::for_each_instruction_set([&](const char* name) {
        std::vector<DescriptorMatch> matches;
        match_descriptors(query, train, ratio, &matches);
        ASSERT_EQ(matches.size(), expected.size()) << name << ", " << size;
        for (size_t i = 0; i < matches.size(); ++i) {
          EXPECT_EQ(matches[i].query, expected[i].query) << name;
          EXPECT_EQ(matches[i].train, expected[i].train) << name;
          EXPECT_EQ(matches[i].distance, expected[i].distance) << name;
        }
      });
    }
  }
}

TEST(Descriptor, NothingMatchesNothing) {
  const std::vector<Descriptor> some = random_descriptors(3, 1);
  std::vector<DescriptorMatch> matches(1);
  match_descriptors(some, {}, 1, &matches);
  EXPECT_TRUE(matches.empty());
  match_descriptors({}, some, 1, &matches);
  EXPECT_TRUE(matches.empty());
}

// A picture of a texture turned about its middle, and where the places of the picture as it stands are then.
constexpr int kSide = 320;
constexpr double kMiddle = (kSide - 1) / 2.0;

Octaves turned_picture(double degrees, double gain = 1, double bias = 0, double sigma = 0) {
  const Texture texture(5, 9, 90, 35);
  const Eigen::Rotation2Dd back(-degrees * std::numbers::pi / 180);
  const Eigen::Vector2d middle(kMiddle, kMiddle);
  const auto place_of = [&](const Eigen::Vector2d& p) -> Eigen::Vector2d { return back * (p - middle); };
  return Octaves(render(texture, kSide, kSide, place_of, gain, bias, sigma), kSide * kSide);
}

std::vector<Eigen::Vector2f> places(double degrees) {
  const Eigen::Rotation2Dd turn(degrees * std::numbers::pi / 180);
  std::vector<Eigen::Vector2f> out;
  for (int y = 90; y <= 230; y += 14) {
    for (int x = 90; x <= 230; x += 14) {
      const Eigen::Vector2d p = turn * Eigen::Vector2d(x - kMiddle, y - kMiddle);
      out.push_back((p.array() + kMiddle).matrix().cast<float>());
    }
  }
  return out;
}

DescriptorSet describe(const Octaves& picture, std::span<const Eigen::Vector2f> pixels) {
  const std::vector<uint8_t> octaves(pixels.size(), static_cast<uint8_t>(picture.first()));
  DescriptorSet set;
  Describer().describe(picture, pixels, octaves, &set);
  return set;
}

class TurnedPicture : public testing::TestWithParam<int> {};

TEST_P(TurnedPicture, PlacesFindThemselvesAgain) {
  const DescriptorSet before = describe(turned_picture(0), places(0));
  const DescriptorSet after = describe(turned_picture(GetParam(), 0.7, 30, 3), places(GetParam()));
  ASSERT_EQ(before.size(), 121);
  ASSERT_EQ(after.size(), 121);
  std::vector<DescriptorMatch> matches;
  match_descriptors(before.descriptors, after.descriptors, 0.8f, &matches);
  const auto right = std::count_if(matches.begin(), matches.end(),
                                   [](const DescriptorMatch& m) { return m.query == m.train; });
  EXPECT_GT(right, 100);
  EXPECT_GT(right, 0.97 * static_cast<double>(matches.size()));
}

INSTANTIATE_TEST_SUITE_P(Descriptor, TurnedPicture, testing::Values(0, 17, 90, 180, 251));

TEST(Descriptor, IsTheSameOnEveryInstructionSet) {
  const Octaves picture = turned_picture(40);
  const DescriptorSet expected = describe(picture, places(40));
  testing_support::for_each_instruction_set([&](const char* name) {
    const DescriptorSet set = describe(picture, places(40));
    ASSERT_EQ(set.corners, expected.corners) << name;
    for (int i = 0; i < set.size(); ++i) {
      EXPECT_EQ(distance(set.descriptors[i], expected.descriptors[i]), 0) << name;
    }
  });
}

TEST(Descriptor, CornersAtTheBorderHaveNone) {
  const Octaves picture = turned_picture(0);
  const std::vector<Eigen::Vector2f> pixels{{0, 160}, {160, 160}, {160, 319}, {319, 160}, {160, 0}};
  const DescriptorSet set = describe(picture, pixels);
  EXPECT_EQ(set.corners, std::vector<int>{1});
}

}  // namespace
}  // namespace raysfm
