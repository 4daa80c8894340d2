#include "raysfm/places/place_index.h"

#include <algorithm>
#include <array>
#include <bit>
#include <limits>

#include "raysfm/places/near_signatures.h"

namespace raysfm {
namespace {

// Comparisons of a descriptor that say least of each other, and come out either way about as often: chosen
// greedily by their correlations (none above 0.32) over key frames of kitti07-mono, kitti00-small and
// redkitchen-handheld. Most of the 256 go together, so that a few of them in a row are equal 50 times more
// often than independent ones would be; of these, quarters are equal 10 to 20 times more often, on
// tsukuba-mono and fr1-rpy too.
constexpr std::array<uint8_t, 64> kTests = {1,   22,  38,  54,  65,  87,  101, 112, 126, 142, 150, 165, 187,
                                            203, 227, 239, 8,   23,  41,  59,  71,  94,  103, 114, 132, 144,
                                            156, 169, 192, 210, 230, 245, 9,   28,  44,  60,  81,  97,  107,
                                            118, 133, 145, 163, 178, 194, 215, 233, 253, 21,  31,  49,  64,
                                            82,  100, 111, 122, 138, 147, 164, 183, 200, 224, 236, 255};
// The same corner seen again differs in about an eighth of these bits, others in 28 with a standard deviation
// of 6.
constexpr int kParts = 4, kPartBits = 15;
constexpr int kMostBitsApart = 20;
constexpr size_t kBuckets = size_t{1} << kPartBits;
constexpr size_t kFirstFiled = 4;  // entries that a bucket has room for at first

// With many places, fewer of the descriptors say which it is: chance gives each place fewer votes. Of views
// between two places that are ten frames apart, 98.3 % have one of them among the best three of 5,000 by 600
// or by 300 descriptors, 95.6 % by 150, 87 % by 100.
constexpr int kAskedInFull = 1000;  // places
constexpr size_t kLeastAsked = 150;

size_t count_to_ask(size_t descriptors, int places) {
  const size_t fewer = descriptors * kAskedInFull / std::max(places, kAskedInFull);
  return std::min(descriptors, std::max(fewer, kLeastAsked));
}

uint64_t signature(const Descriptor& d) {
  uint64_t bits = 0;
  for (const uint8_t test : kTests) bits = bits << 1 | (d.bits[test / 64] >> (63 - test % 64) & 1);
  return bits;
}

std::vector<uint64_t> signatures_to_ask(std::span<const Descriptor> descriptors, int places) {
  std::vector<uint64_t> signatures(count_to_ask(descriptors.size(), places));
  for (size_t i = 0; i < signatures.size(); ++i) {
    signatures[i] = signature(descriptors[i * descriptors.size() / signatures.size()]);
  }
  return signatures;
}

size_t value_of(uint64_t signature, int part) {
  return part * kBuckets + (signature >> (16 * part) & (kBuckets - 1));
}

}  // namespace

// The two places that have the nearest signatures.
struct PlaceIndex::TwoNearest {
  static constexpr int kFar = std::numeric_limits<int>::max();
  int place[2] = {-1, -1}, distance[2] = {kFar, kFar};

  void offer(int p, int d) {
    if (d >= distance[1] || (p == place[0] && d >= distance[0])) return;
    if (p == place[0] || d < distance[0]) {
      if (p != place[0]) place[1] = place[0], distance[1] = distance[0];
      place[0] = p, distance[0] = d;
    } else {
      place[1] = p, distance[1] = d;
    }
  }
};

void PlaceIndex::Bucket::offer_near(uint64_t signature, std::span<const uint8_t> is_skipped,
                                    TwoNearest* nearest) const {
  constexpr size_t kAtOnce = 64;  // what is found in one stretch makes the next one shorter work
  uint32_t found[kAtOnce];
  for (size_t begin = 0; begin < signatures.size(); begin += kAtOnce) {
    const uint64_t* stretch = signatures.data() + begin;
    const int most = std::min(kMostBitsApart, nearest->distance[1] - 1);
    const size_t count =
        find_near_signatures(signature, stretch, std::min(kAtOnce, signatures.size() - begin), most, found);
    for (size_t i = 0; i < count; ++i) {
      const uint32_t place = places[begin + found[i]];
      if (!is_skipped[place])
        nearest->offer(static_cast<int>(place), std::popcount(signature ^ stretch[found[i]]));
    }
  }
}

PlaceIndex::Signatures PlaceIndex::signatures_of(std::span<const Descriptor> descriptors) {
  Signatures signatures;
  signatures.reserve(descriptors.size());
  for (const Descriptor& d : descriptors) signatures.push_back(signature(d));
  return signatures;
}

int PlaceIndex::file(const Signatures& signatures) {
  numbers_.resize(kParts * kBuckets);
  for (size_t i = 0; i < signatures.size(); ++i) {
    fetch_ahead(signatures, i);
    const uint64_t bits = signatures[i];
    for (int part = 0; part < kParts; ++part) {
      uint32_t& number = numbers_[value_of(bits, part)];
      if (number == 0) {
        buckets_.emplace_back();
        number = static_cast<uint32_t>(buckets_.size());
        buckets_.back().signatures.reserve(kFirstFiled);
        buckets_.back().places.reserve(kFirstFiled);
      }
      Bucket& bucket = buckets_[number - 1];
      bucket.signatures.push_back(bits);
      bucket.places.push_back(static_cast<uint32_t>(size_));
    }
  }
  return size_++;
}

void PlaceIndex::keep(std::span<const uint8_t> stays) {
  std::vector<uint32_t> number_now;
  int stay = 0;
  for (const uint8_t s : stays) number_now.push_back(static_cast<uint32_t>(s ? stay++ : stay));
  for (Bucket& bucket : buckets_) {
    size_t kept = 0;
    for (size_t i = 0; i < bucket.places.size(); ++i) {
      if (!stays[bucket.places[i]]) continue;
      bucket.signatures[kept] = bucket.signatures[i];
      bucket.places[kept++] = number_now[bucket.places[i]];
    }
    bucket.signatures.resize(kept);
    bucket.places.resize(kept);
  }
  size_ = stay;
}

// Of signatures that are asked for soon, what memory would be waited for: the numbers of their buckets,
// these, then what is filed.
void PlaceIndex::fetch_ahead(std::span<const uint64_t> asked_for, size_t now) const {
  constexpr size_t kFiled = 3, kBucket = 6, kNumber = 12;  // ahead
  for (int part = 0; part < kParts; ++part) {
    if (now + kNumber < asked_for.size())
      __builtin_prefetch(&numbers_[value_of(asked_for[now + kNumber], part)]);
    if (now + kBucket < asked_for.size()) __builtin_prefetch(find(asked_for[now + kBucket], part));
    const Bucket* soon = now + kFiled < asked_for.size() ? find(asked_for[now + kFiled], part) : nullptr;
    if (soon) __builtin_prefetch(soon->signatures.data());
  }
}

const PlaceIndex::Bucket* PlaceIndex::find(uint64_t signature, int part) const {
  const uint32_t number = numbers_[value_of(signature, part)];
  return number == 0 ? nullptr : &buckets_[number - 1];
}

std::vector<PlaceVotes> PlaceIndex::search(std::span<const Descriptor> descriptors,
                                           std::span<const uint8_t> skip, int most) const {
  if (size_ == 0) return {};
  std::vector<uint8_t> is_skipped(skip.begin(), skip.end());
  is_skipped.resize(size_, 0);
  std::vector<PlaceVotes> places(size_);
  int total = 0;
  const std::vector<uint64_t> asked_for = signatures_to_ask(descriptors, size_);
  for (size_t i = 0; i < asked_for.size(); ++i) {
    fetch_ahead(asked_for, i);
    TwoNearest nearest;
    for (int part = 0; part < kParts; ++part) {
      const Bucket* bucket = find(asked_for[i], part);
      if (bucket) bucket->offer_near(asked_for[i], is_skipped, &nearest);
    }
    for (const int place : nearest.place) {
      if (place < 0) continue;
      ++places[place].votes;
      ++total;
    }
  }
  const auto asked = std::ranges::count(is_skipped, 0);
  for (int p = 0; p < size_; ++p) {
    places[p].place = p;
    places[p].by_chance = double(total) / static_cast<double>(std::max<ptrdiff_t>(asked, 1));
  }
  std::erase_if(places, [](const PlaceVotes& p) { return p.votes == 0; });
  std::ranges::stable_sort(places, std::greater<>(), &PlaceVotes::votes);
  places.resize(std::min<size_t>(places.size(), most));
  return places;
}

}  // namespace raysfm
