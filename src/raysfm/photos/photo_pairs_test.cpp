#include "raysfm/photos/photo_pairs.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "raysfm/core/random.h"

namespace raysfm {
namespace {

// Photos in a circle, in an order that is none: each shows what its neighbours show.
class CircleOfPhotos : public PhotoFeatures {
 public:
  static constexpr int kReach = 3, kNew = 100;  // photos that show a point; points that begin in a photo

  explicit CircleOfPhotos(int photos) : pixels_(photos), codes_(photos) {
    Rng rng(3);
    for (int place = 0; place < photos; ++place) {
      for (int i = 0; i < kNew; ++i) {
        Descriptor code;
        for (uint64_t& bits : code.bits) bits = rng.next();
        for (int step = 0; step < kReach; ++step) {
          const int photo = number((place + step) % photos);
          Descriptor seen = code;
          for (int flip = 0; flip < 12; ++flip) {
            const size_t bit = rng.index(256);
            seen.bits[bit / 64] ^= uint64_t{1} << (bit % 64);
          }
          codes_[photo].push_back(seen);
          pixels_[photo].emplace_back(rng.uniform(0, 640), rng.uniform(0, 480));
        }
      }
    }
  }
  int number(int place) const { return place * 37 % photos(); }

  Result<void> add(const GrayView& /*image*/, int /*max_features*/) override { return {}; }
  int photos() const override { return static_cast<int>(pixels_.size()); }
  const std::vector<Eigen::Vector2d>& pixels(int photo) const override { return pixels_[photo]; }
  std::vector<PhotoMatch> match(int /*a*/, int /*b*/, float /*max_ratio*/) const override { return {}; }
  std::vector<Descriptor> codes(int photo) const override { return codes_[photo]; }

 private:
  std::vector<std::vector<Eigen::Vector2d>> pixels_;
  std::vector<std::vector<Descriptor>> codes_;
};

TEST(PhotoPairs, OfAFewAreAll) {
  ThreadPool pool(0);
  const auto pairs = pairs_to_compare(CircleOfPhotos(20), &pool);
  EXPECT_EQ(pairs.size(), 190u);
}

TEST(PhotoPairs, OfManyAreThoseThatLookAlikeOnAnyNumberOfThreads) {
  constexpr int kPhotos = 200;
  const CircleOfPhotos photos(kPhotos);
  ThreadPool one(0), three(2);
  const auto pairs = pairs_to_compare(photos, &one);
  EXPECT_EQ(pairs, pairs_to_compare(photos, &three));
  EXPECT_TRUE(std::ranges::is_sorted(pairs));
  EXPECT_EQ(std::ranges::adjacent_find(pairs), pairs.end());
  EXPECT_LT(pairs.size(), size_t{kPhotos * 23});
  for (int place = 0; place < kPhotos; ++place) {
    for (int step = 1; step < CircleOfPhotos::kReach; ++step) {
      const std::pair<int, int> near =
          std::minmax(photos.number(place), photos.number((place + step) % kPhotos));
      EXPECT_TRUE(std::ranges::binary_search(pairs, near)) << near.first << " " << near.second;
    }
  }
}

TEST(PhotoPairs, AreNotComparedOnceAskedToStop) {
  const CircleOfPhotos photos(10);
  ThreadPool pool(0);
  const std::atomic<bool> stop = true;
  const MatchedPairs pairs = match_pairs(photos, pairs_to_compare(photos, &pool), &stop, &pool);
  const auto same = compare_pairs(photos, pairs, {.stop = &stop}, &pool);
  EXPECT_EQ(same.size(), 45u);
  EXPECT_TRUE(std::ranges::all_of(same, [](const SamePoints& s) { return s.empty(); }));
}

}  // namespace
}  // namespace raysfm
