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

int distance(const UprightDescriptor& a, const UprightDescriptor& b) {
  int least = 256;
  for (const Descriptor& of_a : a) {
    for (const Descriptor& of_b : b) least = std::min(least, distance(of_a, of_b));
  }
  return least;
}

// The definition, in plain loops.
template <typename D>
std::vector<DescriptorMatch> match_plainly(std::span<const D> query, std::span<const D> train,
                                           float max_ratio) {
  const auto nearest = [](const D& d, std::span<const D> others, int without) {
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

template <typename D>
void expect_matches_of_the_definition(const std::vector<D>& query, const std::vector<D>& train) {
  for (const float ratio : {0.8f, 1.0f}) {
    const std::vector<DescriptorMatch> expected =
        match_plainly(std::span<const D>(query), std::span<const D>(train), ratio);
    ASSERT_FALSE(expected.empty());
    testing_support::for_each_instruction_set([&](const char* name) {
      std::vector<DescriptorMatch> matches;
      match_descriptors(query, train, ratio, &matches);
      ASSERT_EQ(matches.size(), expected.size()) << name << ", " << train.size();
      for (size_t i = 0; i < matches.size(); ++i) {
        EXPECT_EQ(matches[i].query, expected[i].query) << name;
        EXPECT_EQ(matches[i].train, expected[i].train) << name;
        EXPECT_EQ(matches[i].distance, expected[i].distance) << name;
      }
    });
  }
}

TEST(Descriptor, MatchesAreThoseOfTheDefinitionOnEveryInstructionSet) {
  for (const int size : {1, 2, 7, 8, 9, 150}) {
    const std::vector<Descriptor> train = random_descriptors(size, 1);
    std::vector<Descriptor> query = random_descriptors(40, 2);
    for (int i = 0; i < 40; i += 2) query[i] = flipped(train[3 * i % size], i);
    expect_matches_of_the_definition(query, train);
  }
}

// Of two sizes each. Train descriptors look like a query at one size, or at both, or two of them like one
// query.
TEST(UprightDescriptor, MatchesAreThoseOfTheDefinitionOnEveryInstructionSet) {
  for (const int size : {1, 2, 7, 8, 9, 150}) {
    const std::vector<Descriptor> first = random_descriptors(size, 1), second = random_descriptors(size, 2);
    const std::vector<Descriptor> others = random_descriptors(80, 3);
    std::vector<UprightDescriptor> train, query;
    for (int t = 0; t < size; ++t) train.push_back({first[t], second[t]});
    for (int i = 0; i < 40; ++i) {
      UprightDescriptor& q = query.emplace_back(UprightDescriptor{others[2 * i], others[2 * i + 1]});
      if (i % 2 == 0) q[i / 2 % 2] = flipped(train[3 * i % size][i / 4 % 2], i);
      if (i % 8 == 0) q[1] = flipped(q[0], i / 4);
      if (i % 10 == 0) q[1] = flipped(train[(3 * i + 1) % size][0], i + 6);
    }
    expect_matches_of_the_definition(query, train);
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

Octaves picture_through(const Eigen::Matrix2d& picture_from_texture, double gain = 1, double bias = 0,
                        double sigma = 0) {
  const Texture texture(5, 9, 90, 35);
  const Eigen::Matrix2d back = picture_from_texture.inverse();
  const Eigen::Vector2d middle(kMiddle, kMiddle);
  const auto place_of = [&](const Eigen::Vector2d& p) -> Eigen::Vector2d { return back * (p - middle); };
  return Octaves(render(texture, kSide, kSide, place_of, gain, bias, sigma), kSide * kSide);
}

Eigen::Matrix2d turn_by(double degrees) {
  return Eigen::Rotation2Dd(degrees * std::numbers::pi / 180).toRotationMatrix();
}

Octaves turned_picture(double degrees, double gain = 1, double bias = 0, double sigma = 0) {
  return picture_through(turn_by(degrees), gain, bias, sigma);
}

std::vector<Eigen::Vector2f> places_through(const Eigen::Matrix2d& turn) {
  std::vector<Eigen::Vector2f> out;
  for (int y = 90; y <= 230; y += 14) {
    for (int x = 90; x <= 230; x += 14) {
      const Eigen::Vector2d p = turn * Eigen::Vector2d(x - kMiddle, y - kMiddle);
      out.push_back((p.array() + kMiddle).matrix().cast<float>());
    }
  }
  return out;
}

std::vector<Eigen::Vector2f> places(double degrees) {
  return places_through(turn_by(degrees));
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

std::vector<UprightDescriptor> describe_upright(const Octaves& picture,
                                                std::span<const Eigen::Vector2f> pixels) {
  const std::vector<uint8_t> octaves(pixels.size(), static_cast<uint8_t>(picture.first()));
  std::vector<UprightDescriptor> out;
  Describer().describe_upright(picture, pixels, octaves, &out);
  return out;
}

template <typename D>
int right_matches(const std::vector<D>& before, const std::vector<D>& after) {
  std::vector<DescriptorMatch> matches;
  match_descriptors(before, after, 0.85f, &matches);
  return static_cast<int>(
      std::ranges::count_if(matches, [](const DescriptorMatch& m) { return m.query == m.train; }));
}

// A wall seen from the front, then aslant and larger.
TEST(UprightDescriptor, FindsMoreFromAsideThanTheOneThatTurns) {
  const Eigen::Matrix2d slant = turn_by(8) * Eigen::DiagonalMatrix<double, 2>(0.75, 1.4);
  const Octaves front = picture_through(Eigen::Matrix2d::Identity()),
                aside = picture_through(slant, 0.8, 20, 3);
  const auto here = places(0), there = places_through(slant);
  const int turning = right_matches(describe(front, here).descriptors, describe(aside, there).descriptors);
  const int upright = right_matches(describe_upright(front, here), describe_upright(aside, there));
  EXPECT_GT(upright, 1.3 * turning);
  EXPECT_GT(upright, 40);
}

// A corner of a coarser octave looks the same twice as near.
TEST(UprightDescriptor, IsOfTheOctaveOfItsCorner) {
  const Octaves far = picture_through(Eigen::Matrix2d::Identity()),
                near = picture_through(2 * Eigen::Matrix2d::Identity());
  std::vector<Eigen::Vector2f> here, there;
  for (const Eigen::Vector2f& p : places(0)) {
    const Eigen::Vector2f twice = (2 * (p.array() - kMiddle) + kMiddle).matrix();
    if (twice.minCoeff() < 40 || twice.maxCoeff() > kSide - 40) continue;
    here.push_back(p);
    there.push_back(twice);
  }
  ASSERT_EQ(far.first(), 0);
  const std::vector<uint8_t> fine(here.size(), 0), coarse(here.size(), 1);
  std::vector<UprightDescriptor> of_far, of_near;
  Describer().describe_upright(far, here, fine, &of_far);
  Describer().describe_upright(near, there, coarse, &of_near);
  for (size_t i = 0; i < here.size(); ++i) {
    for (int size = 0; size < kUprightSizes; ++size)
      EXPECT_LT(distance(of_far[i][size], of_near[i][size]), 50);
  }
}

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
