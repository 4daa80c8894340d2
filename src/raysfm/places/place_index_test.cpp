#include "raysfm/places/place_index.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "raysfm/core/random.h"
#include "raysfm/places/place_memory.h"
#include "support/panel_world.h"

namespace raysfm {
namespace {

std::vector<Descriptor> random_descriptors(int count, Rng& rng) {
  std::vector<Descriptor> out(count);
  for (Descriptor& d : out) {
    for (uint64_t& word : d.bits) word = rng.next();
  }
  return out;
}

// Each bit turned with a probability.
std::vector<Descriptor> seen_again(std::vector<Descriptor> descriptors, double turned, Rng& rng) {
  for (Descriptor& d : descriptors) {
    for (int bit = 0; bit < 256; ++bit) {
      if (rng.uniform() < turned) d.bits[bit / 64] ^= uint64_t{1} << (bit % 64);
    }
  }
  return descriptors;
}

struct ManyPlaces {
  Rng rng{3};
  std::vector<std::vector<Descriptor>> places;
  PlaceIndex index;

  explicit ManyPlaces(int count, int descriptors = 300) {
    for (int p = 0; p < count; ++p) {
      places.push_back(random_descriptors(descriptors, rng));
      EXPECT_EQ(index.add(places.back()), p);
    }
  }
};

bool same(const std::vector<PlaceVotes>& a, const std::vector<PlaceVotes>& b) {
  return std::ranges::equal(a, b, [](const PlaceVotes& x, const PlaceVotes& y) {
    return x.place == y.place && x.votes == y.votes && x.by_chance == y.by_chance;
  });
}

TEST(PlaceIndex, FindsAPlaceOfWhichAnEighthOfTheBitsChanged) {
  ManyPlaces many(300);
  for (const int place : {0, 117, 299}) {
    const auto votes =
        many.index.search(seen_again(many.places[place], 1.0 / 8, many.rng), {}, many.index.size());
    ASSERT_GE(votes.size(), 2u);
    EXPECT_EQ(votes[0].place, place);
    // 0.44 of the descriptors keep 15 bits of a quarter.
    EXPECT_GT(votes[0].votes, 0.35 * 300);
    EXPECT_GT(votes[0].votes, 10 * votes[1].votes);
  }
}

// Of very many places it is told by a part of the descriptors, from all over the list.
TEST(PlaceIndex, AsksForFewerOfManyPlaces) {
  ManyPlaces many(4000, 20);
  std::vector<Descriptor> asked;
  for (int place = 0; place < 3; ++place) {
    const std::vector<Descriptor> all = random_descriptors(200, many.rng);
    many.index.add(all);
    const auto votes = many.index.search(seen_again(all, 0.02, many.rng), {}, 1);
    ASSERT_EQ(votes.size(), 1u);
    EXPECT_EQ(votes[0].place, many.index.size() - 1) << place;
    EXPECT_GT(votes[0].votes, 140);
    EXPECT_LE(votes[0].votes, 150);
    asked.insert(asked.end(), all.begin(), all.end());
  }
  // Three places that are asked for together have about as many votes each.
  for (const PlaceVotes& v : many.index.search(asked, {}, 3)) {
    EXPECT_GE(v.place, 4000);
    EXPECT_NEAR(v.votes, 50, 10);
  }
}

TEST(PlaceIndex, PlacesToBeSkippedGetNoVotes) {
  ManyPlaces many(20);
  // Descriptors of two places.
  std::vector<Descriptor> asked = seen_again(many.places[4], 0.05, many.rng);
  const std::vector<Descriptor> others = seen_again(many.places[9], 0.05, many.rng);
  asked.insert(asked.end(), others.begin(), others.end());
  std::vector<uint8_t> skip(20, 0);
  skip[4] = 1;
  auto votes = many.index.search(asked, skip, 20);
  ASSERT_FALSE(votes.empty());
  EXPECT_EQ(votes[0].place, 9);
  for (const PlaceVotes& v : votes) EXPECT_NE(v.place, 4);
  // Shorter than the places: none of the rest is skipped. Longer: what is beyond them says nothing.
  skip.resize(5);
  EXPECT_TRUE(same(many.index.search(asked, skip, 20), votes));
  skip.resize(90, 0);
  EXPECT_TRUE(same(many.index.search(asked, skip, 20), votes));
  skip.assign(20, 1);
  EXPECT_TRUE(many.index.search(asked, skip, 20).empty());
}

// Two votes of a descriptor go to two places, however many descriptors of one place are near.
TEST(PlaceIndex, ADescriptorVotesForTwoPlaces) {
  Rng rng(5);
  const std::vector<Descriptor> one = random_descriptors(1, rng);
  std::vector<Descriptor> nearly = one;
  nearly[0].bits[3] ^= 1;
  PlaceIndex index;
  index.add(std::vector<Descriptor>{one[0], one[0], nearly[0]});
  index.add(nearly);
  index.add(std::vector<Descriptor>{one[0], nearly[0]});
  auto votes = index.search(nearly, {}, 3);
  ASSERT_EQ(votes.size(), 2u);
  for (const PlaceVotes& v : votes) EXPECT_EQ(v.votes, 1);
  // The two that are equal to it: of place 0, which is met first, and of place 1.
  EXPECT_EQ(votes[0].place, 0);
  EXPECT_EQ(votes[1].place, 1);
  EXPECT_DOUBLE_EQ(votes[0].by_chance, 2.0 / 3);
  const std::vector<uint8_t> skip{1};
  votes = index.search(nearly, skip, 3);
  ASSERT_EQ(votes.size(), 2u);
  EXPECT_DOUBLE_EQ(votes[0].by_chance, 2.0 / 2);
}

// The nearest of a place counts, in whatever order they come.
TEST(PlaceIndex, TheNearestTwoPlacesHaveTheVotes) {
  Rng rng(6);
  const Descriptor asked = random_descriptors(1, rng)[0];
  for (int trial = 0; trial < 50; ++trial) {
    PlaceIndex index;
    const int nearest = static_cast<int>(rng.index(6)), next = (nearest + 1 + rng.index(5)) % 6;
    for (int p = 0; p < 6; ++p) {
      const double turned = p == nearest ? 0.0 : p == next ? 0.004 : 0.2;
      std::vector<Descriptor> descriptors = seen_again({asked, asked, asked}, 0.2, rng);
      descriptors.insert(descriptors.begin() + rng.index(4), seen_again({asked}, turned, rng)[0]);
      index.add(descriptors);
    }
    const auto votes = index.search(std::vector<Descriptor>{asked}, {}, 6);
    ASSERT_EQ(votes.size(), 2u);
    EXPECT_EQ(std::min(votes[0].place, votes[1].place), std::min(nearest, next)) << trial;
    EXPECT_EQ(std::max(votes[0].place, votes[1].place), std::max(nearest, next)) << trial;
  }
}

// Unknown places: the votes are spread over all, as by_chance says, and none stands out.
TEST(PlaceIndex, VotesByChanceAreWhatUnrelatedPlacesHave) {
  Rng rng(8);
  PlaceIndex index;
  // Descriptors that agree in most bits, so that unrelated ones share quarters.
  const Descriptor common = random_descriptors(1, rng)[0];
  const auto alike = [&] { return seen_again(std::vector<Descriptor>(400, common), 0.14, rng); };
  for (int p = 0; p < 60; ++p) index.add(alike());
  const auto votes = index.search(alike(), {}, 60);
  ASSERT_EQ(votes.size(), 60u);
  int total = 0;
  double most = 0;
  for (const PlaceVotes& v : votes) {
    EXPECT_DOUBLE_EQ(v.by_chance, votes[0].by_chance);
    total += v.votes;
    most = std::max(most, v.votes - v.by_chance);
  }
  EXPECT_DOUBLE_EQ(votes[0].by_chance, total / 60.0);
  EXPECT_GT(votes[0].by_chance, 3);
  EXPECT_LT(most, 5 * std::sqrt(votes[0].by_chance));
}

TEST(PlaceIndex, BestFirstThenTheLowerNumber) {
  ManyPlaces many(30, 40);
  // The first 10 descriptors of places 7 and 3, the first 20 of 12.
  std::vector<Descriptor> asked;
  for (const auto& [place, count] : {std::pair{7, 10}, {12, 20}, {3, 10}}) {
    asked.insert(asked.end(), many.places[place].begin(), many.places[place].begin() + count);
  }
  auto votes = many.index.search(asked, {}, 3);
  ASSERT_EQ(votes.size(), 3u);
  EXPECT_EQ(votes[0].place, 12);
  EXPECT_EQ(votes[1].place, 3);
  EXPECT_EQ(votes[2].place, 7);
  EXPECT_EQ(votes[1].votes, votes[2].votes);
  EXPECT_EQ(many.index.search(asked, {}, 1).size(), 1u);
  EXPECT_TRUE(many.index.search(asked, {}, 0).empty());
}

TEST(PlaceIndex, NothingIsFoundInNothing) {
  PlaceIndex index;
  Rng rng(1);
  const std::vector<Descriptor> some = random_descriptors(50, rng);
  EXPECT_TRUE(index.search(some, {}, 5).empty());
  EXPECT_EQ(index.size(), 0);
  EXPECT_EQ(index.add({}), 0);
  EXPECT_EQ(index.size(), 1);
  EXPECT_TRUE(index.search(some, {}, 5).empty());
  EXPECT_TRUE(index.search({}, {}, 5).empty());
  EXPECT_EQ(index.add(some), 1);
  EXPECT_TRUE(index.search({}, {}, 5).empty());
  const auto votes = index.search(some, {}, 5);
  ASSERT_EQ(votes.size(), 1u);
  EXPECT_EQ(votes[0].place, 1);
  EXPECT_EQ(votes[0].votes, 50);
}

// Also whatever was asked before, and among which memory it lies.
TEST(PlaceIndex, TheSameCallsGiveTheSame) {
  ManyPlaces a(50, 100), b(50, 100);
  Rng rng(9);
  const std::vector<Descriptor> asked = seen_again(a.places[20], 0.1, rng);
  for (int i = 0; i < 10; ++i) a.index.search(a.places[i], {}, 5);
  const auto votes = a.index.search(asked, {}, 50);
  EXPECT_GT(votes.size(), 1u);
  EXPECT_TRUE(same(votes, b.index.search(asked, {}, 50)));
  EXPECT_TRUE(same(votes, PlaceIndex(b.index).search(asked, {}, 50)));
}

TEST(PlaceIndex, WithoutSomePlacesItIsOneThatNeverHadThem) {
  ManyPlaces many(60);
  std::vector<uint8_t> stays(60);
  PlaceIndex fewer;
  for (int p = 0; p < 60; ++p) {
    stays[p] = p % 3 != 0;
    if (stays[p]) fewer.add(many.places[p]);
  }
  many.index.keep(stays);
  ASSERT_EQ(many.index.size(), 40);
  for (const int place : {0, 1, 33, 59}) {
    const auto seen = seen_again(many.places[place], 1.0 / 8, many.rng);
    const auto votes = many.index.search(seen, {}, 40);
    EXPECT_TRUE(same(votes, fewer.search(seen, {}, 40))) << place;
    const bool is_found = votes[0].votes > 0.35 * 300;
    EXPECT_EQ(is_found, stays[place] != 0) << place;
  }
  EXPECT_EQ(many.index.add(many.places[0]), 40);
}

// Four places of each of two worlds. Of the first, the key frames before 30 were gone through: those of two
// places stand for nothing new, one of which is gone, with the two before it.
TEST(PlaceMemory, PlacesThatStandForNothingNewAreForgottenAndOthersFollowTheirKeyFrames) {
  Rng rng(5);
  const TrackingRig rig(Rig{{testing_support::small_camera()}});
  PlaceMemory memory(rig, 0);
  std::vector<MapKeyFrame> keyframes(8);
  for (int p = 0; p < 8; ++p) {
    const auto descriptors = random_descriptors(300, rng);
    keyframes[p].descriptors.assign(descriptors.begin(), descriptors.end());
    memory.add({p / 4, 10 * (p % 4)}, keyframes[p]);
  }
  std::vector<uint8_t> is_known(30, 0);
  is_known[10] = is_known[20] = 1;
  std::vector<int> now;
  for (int k = 0; k < 40; ++k) now.push_back(k < 18 ? k : k <= 20 ? 17 : k - 3);
  memory.drop(0, is_known, now);
  ASSERT_EQ(memory.size(), 6);
  const auto nearest = [&](int p) {
    const auto& d = keyframes[p].descriptors;
    return memory.most_like({{}, {d.begin(), d.end()}}, 1).at(0);
  };
  const auto is = [](const PlaceRef& p, int world, int keyframe) {
    return p.world == world && p.keyframe == keyframe;
  };
  EXPECT_TRUE(is(nearest(0), 0, 0));
  EXPECT_TRUE(is(nearest(3), 0, 27));
  for (int p = 4; p < 8; ++p) EXPECT_TRUE(is(nearest(p), 1, 10 * (p - 4))) << p;
  for (const int gone : {1, 2}) EXPECT_FALSE(is(nearest(gone), 0, 10 * gone)) << gone;
}

}  // namespace
}  // namespace raysfm
