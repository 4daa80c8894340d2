#include "raysfm/features/descriptor.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>

#include "raysfm/core/random.h"
#include "raysfm/image/blur.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "raysfm/features/descriptor.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#ifndef RAYSFM_FEATURES_DESCRIPTOR_ONCE
#define RAYSFM_FEATURES_DESCRIPTOR_ONCE
namespace raysfm {
namespace {

constexpr int kDiscRadius = 15;  // pixels of the octave looked at, of the disc with all that is compared
constexpr int kDiscSide = 2 * kDiscRadius + 2;  // rows are looked at with one pixel more

struct Offset {
  int x = 0, y = 0;
};

// For each row of the disc, from its left: all bits of the pixels within it.
struct DiscRows {
  constexpr DiscRows() {
    for (int y = -kDiscRadius; y <= kDiscRadius; ++y) {
      for (int x = -kDiscRadius; x <= kDiscRadius; ++x) {
        if (x * x + y * y <= kDiscRadius * kDiscRadius) inside[y + kDiscRadius][x + kDiscRadius] = 255;
      }
    }
    for (int x = -kDiscRadius; x <= kDiscRadius; ++x) column[x + kDiscRadius] = static_cast<int16_t>(x);
  }
  alignas(64) uint8_t inside[2 * kDiscRadius + 1][kDiscSide] = {};
  alignas(64) int16_t column[kDiscSide] = {};
};
constexpr DiscRows kDisc;

}  // namespace
}  // namespace raysfm
#endif

HWY_BEFORE_NAMESPACE();
namespace raysfm {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// Sums of x and of y, from the middle of a disc, times the grey levels there. The sums of columns fit 16
// bits, and all are exact.
Offset disc_moments(const GrayView& image, int x, int y) {
  const hn::CappedTag<int16_t, kDiscSide> d;
  const hn::Rebind<uint8_t, decltype(d)> bytes;
#if HWY_TARGET == HWY_SCALAR
  const hn::Rebind<int32_t, decltype(d)> sums;
#else
  const hn::RepartitionToWide<decltype(d)> sums;
#endif
  auto along_x = hn::Zero(sums), along_y = along_x, more_x = along_x, more_y = along_x;
  for (int c = 0; c < kDiscSide; c += static_cast<int>(hn::Lanes(d))) {
    auto column = hn::Zero(d);
    for (int r = 0; r <= 2 * kDiscRadius; ++r) {
      const uint8_t* pixels = image.row(y + r - kDiscRadius) + x - kDiscRadius + c;
      const auto levels =
          hn::PromoteTo(d, hn::And(hn::LoadU(bytes, pixels), hn::Load(bytes, kDisc.inside[r] + c)));
      const auto height = hn::Set(d, static_cast<int16_t>(r - kDiscRadius));
      column = hn::Add(column, levels);
      along_y = hn::ReorderWidenMulAccumulate(sums, levels, height, along_y, more_y);
    }
    along_x = hn::ReorderWidenMulAccumulate(sums, column, hn::Load(d, kDisc.column + c), along_x, more_x);
  }
  return {hn::GetLane(hn::SumOfLanes(sums, hn::Add(along_x, more_x))),
          hn::GetLane(hn::SumOfLanes(sums, hn::Add(along_y, more_y)))};
}

// A rank is a distance times 2^32 plus the index that it belongs to: the lower rank is the nearer one, of
// equal ones that of the lower index. Lowers the two least ranks that query q sees, kept by lane, and what
// the train descriptors from `begin` on see in it, as far as whole vectors go; returns where that is. Word w
// of the train descriptors begins at words + w * size.
template <class D>
int rank_all(D d, const Descriptor& query, int q, const uint64_t* HWY_RESTRICT words, int begin, int size,
             uint64_t* HWY_RESTRICT two_best, uint64_t* HWY_RESTRICT best_of_train) {
  const int lanes = static_cast<int>(hn::Lanes(d));
  const auto differing = [&](int w, int t) HWY_ATTR {
    return hn::PopulationCount(hn::Xor(hn::Set(d, query.bits[w]), hn::LoadU(d, words + w * size + t)));
  };
  auto best = hn::LoadU(d, two_best), second = hn::LoadU(d, two_best + lanes);
  const auto seen_by_train = hn::Set(d, static_cast<uint64_t>(q));
  for (; begin + lanes <= size; begin += lanes) {
    const auto low = hn::Add(differing(0, begin), differing(1, begin));
    const auto high = hn::Add(differing(2, begin), differing(3, begin));
    const auto distance = hn::ShiftLeft<32>(hn::Add(low, high));
    const auto rank = hn::Or(distance, hn::Iota(d, static_cast<uint64_t>(begin)));
    second = hn::Min(second, hn::Max(best, rank));
    best = hn::Min(best, rank);
    uint64_t* train = best_of_train + begin;
    hn::StoreU(hn::Min(hn::LoadU(d, train), hn::Or(distance, seen_by_train)), d, train);
  }
  hn::StoreU(best, d, two_best);
  hn::StoreU(second, d, two_best + lanes);
  return begin;
}

// The two least ranks among all train descriptors.
void find_two_best(const Descriptor& query, int q, const uint64_t* words, int size, uint64_t* two_best,
                   uint64_t* best_of_train) {
  const hn::CappedTag<uint64_t, 8> d;
  const hn::CappedTag<uint64_t, 1> one;
  const int lanes = static_cast<int>(hn::Lanes(d));
  uint64_t by_lane[16];
  std::fill_n(by_lane, 2 * lanes, std::numeric_limits<uint64_t>::max());
  std::fill_n(two_best, 2, std::numeric_limits<uint64_t>::max());
  const int done = rank_all(d, query, q, words, 0, size, by_lane, best_of_train);
  rank_all(one, query, q, words, done, size, two_best, best_of_train);
  for (int i = 0; i < 2 * lanes; ++i) {
    two_best[1] = std::min(two_best[1], std::max(two_best[0], by_lane[i]));
    two_best[0] = std::min(two_best[0], by_lane[i]);
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace raysfm
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace raysfm {

HWY_EXPORT(find_two_best);
HWY_EXPORT(disc_moments);

namespace {

constexpr int kTests = 256;
// Tried on herzjesu-p8, fountain-p11 and redkitchen-handheld: radii from 11 to 15, spreads from half the
// radius to an even one, a blur less and two more, the octave of the corner itself (a fifth of the matches
// fewer).
constexpr int kRadius = kDiscRadius;
constexpr int kOutside = 8;      // pixels by which a disc may leave the picture
constexpr int kMargin = 16;      // pixels about a picture, so that a larger one may too
constexpr int kDirections = 64;  // of the pattern
constexpr int kFixed = 1 << 12;

// Unit vectors, times kFixed. By multiplication of complex numbers: library functions of angles differ
// between machines.
constexpr std::array<Offset, kDirections> make_directions() {
  constexpr double kCos = 0.99518472667219688624, kSin = 0.09801714032956060199;  // of 2 pi / kDirections
  std::array<Offset, kDirections> directions;
  double x = 1, y = 0;
  for (Offset& d : directions) {
    const auto round = [](double v) { return static_cast<int>(kFixed * v + (v < 0 ? -0.5 : 0.5)); };
    d = {round(x), round(y)};
    const double turned = kCos * x - kSin * y;
    y = kSin * x + kCos * y;
    x = turned;
  }
  return directions;
}
constexpr std::array<Offset, kDirections> kUnit = make_directions();

struct Test {
  int8_t ax, ay, bx, by;
};

// Points are drawn denser towards the corner, where two views differ least.
Offset draw_point(Rng& rng) {
  constexpr int kSpread = 8;
  for (;;) {
    Offset p;
    for (int i = 0; i < 2; ++i) {
      p.x += static_cast<int>(rng.index(2 * kSpread + 1)) - kSpread;
      p.y += static_cast<int>(rng.index(2 * kSpread + 1)) - kSpread;
    }
    if (p.x * p.x + p.y * p.y < kRadius * kRadius) return p;
  }
}

using Pattern = std::array<Test, kTests>;

// A pattern of points times a complex number, in units of kFixed.
Pattern times(const Pattern& pattern, const Offset& factor) {
  const auto round = [](int v) {
    return static_cast<int8_t>((v + (v < 0 ? -kFixed / 2 : kFixed / 2)) / kFixed);
  };
  const auto x = [&](int px, int py) { return round(factor.x * px - factor.y * py); };
  const auto y = [&](int px, int py) { return round(factor.y * px + factor.x * py); };
  Pattern out;
  for (int i = 0; i < kTests; ++i) {
    const Test& t = pattern[i];
    out[i] = {x(t.ax, t.ay), y(t.ax, t.ay), x(t.bx, t.by), y(t.bx, t.by)};
  }
  return out;
}

Pattern make_upright_pattern() {
  constexpr int kMinDistance = 3;
  Pattern pattern;
  Rng rng(2);
  for (Test& test : pattern) {
    Offset a, b, apart;
    do {
      a = draw_point(rng), b = draw_point(rng);
      apart = {a.x - b.x, a.y - b.y};
    } while (apart.x * apart.x + apart.y * apart.y < kMinDistance * kMinDistance);
    test = {static_cast<int8_t>(a.x), static_cast<int8_t>(a.y), static_cast<int8_t>(b.x),
            static_cast<int8_t>(b.y)};
  }
  return pattern;
}

// The tests in every direction.
std::array<Pattern, kDirections> make_patterns() {
  const Pattern upright = make_upright_pattern();
  std::array<Pattern, kDirections> patterns;
  for (int d = 0; d < kDirections; ++d) patterns[d] = times(upright, kUnit[d]);
  return patterns;
}

// Upright ones: for the octave of a corner and for the next coarser one, there less than twice as large.
std::array<Pattern, kUprightSizes> make_upright_patterns() {
  constexpr int kLarger = 1448;  // times 1024: the square root of two
  static_assert(kRadius * kLarger / 1024 <= kRadius - kOutside + kMargin - 1);
  const Pattern upright = make_upright_pattern();
  return {times(upright, {kLarger * kFixed / 1024, 0}), upright};
}

// Direction of the centroid of the intensities of the disc (Rosin 1999).
int direction_at(const GrayView& image, int x, int y) {
  const auto [along_x, along_y] = HWY_DYNAMIC_DISPATCH(disc_moments)(image, x, y);
  int best = 0;
  int64_t most = std::numeric_limits<int64_t>::min();
  for (int d = 0; d < kDirections; ++d) {
    const int64_t along = int64_t{kUnit[d].x} * along_x + int64_t{kUnit[d].y} * along_y;
    if (along > most) most = along, best = d;
  }
  return best;
}

Descriptor describe_at(const GrayView& image, int x, int y, const Pattern& tests) {
  const uint8_t* centre = image.row(y) + x;
  const auto stride = static_cast<int>(image.stride);
  Descriptor out;
  for (int word = 0; word < 4; ++word) {
    uint64_t bits = 0;
    for (int i = 0; i < 64; ++i) {
      const Test& t = tests[64 * word + i];
      bits = bits << 1 | (centre[t.ay * stride + t.ax] < centre[t.by * stride + t.bx]);
    }
    out.bits[word] = bits;
  }
  return out;
}

}  // namespace

// Of a corner in an octave: its pixel in the image with margins; false where too little of the picture is
// about it.
bool find_place(const Eigen::Vector2f& in_octave, const GrayImage& padded, int* x, int* y) {
  constexpr int kLeast = kMargin + kRadius - kOutside;
  *x = kMargin + static_cast<int>(std::lround(in_octave.x()));
  *y = kMargin + static_cast<int>(std::lround(in_octave.y()));
  return *x >= kLeast && *y >= kLeast && *x + kLeast < padded.width() && *y + kLeast < padded.height();
}

const GrayImage& Describer::smooth(const Octaves& picture, int octave) {
  GrayImage& padded = smooth_[octave];
  if (!padded.empty()) return padded;
  blur3(picture.at(octave), kBinomial, &once_);
  blur3(once_, kBinomial, &twice_);
  const int width = twice_.width(), height = twice_.height();
  padded = GrayImage(width + 2 * kMargin, height + 2 * kMargin);
  for (int y = 0; y < padded.height(); ++y) {
    const uint8_t* from = twice_.row(std::clamp(y - kMargin, 0, height - 1));
    uint8_t* to = padded.row(y);
    std::fill_n(to, kMargin, from[0]);
    std::copy_n(from, width, to + kMargin);
    std::fill_n(to + kMargin + width, kMargin, from[width - 1]);
  }
  return padded;
}

void Describer::describe(const Octaves& picture, std::span<const Eigen::Vector2f> pixels,
                         std::span<const uint8_t> octaves, DescriptorSet* out) {
  static const auto kPatterns = make_patterns();
  out->corners.clear();
  out->descriptors.clear();
  smooth_.clear();
  smooth_.resize(picture.last() + 1);
  for (size_t i = 0; i < pixels.size(); ++i) {
    // The next coarser one: twice the disc tells more than twice the detail.
    const int octave = picture.clamp(octaves[i] + 1);
    const GrayImage& image = smooth(picture, octave);
    int x, y;
    if (!find_place(into_octave(pixels[i], octave), image, &x, &y)) continue;
    out->corners.push_back(static_cast<int>(i));
    out->descriptors.push_back(describe_at(image, x, y, kPatterns[direction_at(image, x, y)]));
  }
}

void Describer::describe_upright(const Octaves& picture, std::span<const Eigen::Vector2f> pixels,
                                 std::span<const uint8_t> octaves, std::vector<UprightDescriptor>* out) {
  static const auto kPatterns = make_upright_patterns();
  smooth_.clear();
  smooth_.resize(picture.last() + 1);
  out->assign(pixels.size(), {});
  for (size_t i = 0; i < pixels.size(); ++i) {
    for (int size = 0; size < kUprightSizes; ++size) {
      const int octave = picture.clamp(octaves[i] + size);
      const GrayImage& image = smooth(picture, octave);
      int x, y;
      if (!find_place(into_octave(pixels[i], octave), image, &x, &y)) continue;
      (*out)[i][size] = describe_at(image, x, y, kPatterns[size]);
    }
  }
}

namespace {

constexpr uint64_t kNone = std::numeric_limits<uint64_t>::max();

// Of a rank.
uint64_t index_of(uint64_t rank) {
  return static_cast<uint32_t>(rank);
}
float distance_of(uint64_t rank) {
  return static_cast<float>(rank >> 32);
}

// The two least ranks of different indices, of those that a query was offered.
struct TwoRanks {
  uint64_t best = kNone, second = kNone;

  void offer(uint64_t rank) {
    if (rank >= second) return;
    if (rank >= best) {
      if (index_of(rank) != index_of(best)) second = rank;
      return;
    }
    if (index_of(rank) != index_of(best)) second = best;
    best = rank;
  }
};

// Ranks each train descriptor for each query, both ways. What is ranked before counts too.
template <typename QueryAt, typename TrainAt>
void rank_both_ways(size_t queries, size_t trains, const QueryAt& query_at, const TrainAt& train_at,
                    std::vector<TwoRanks>* of_query, std::vector<uint64_t>* best_of_train) {
  std::vector<uint64_t> words(4 * trains);
  for (size_t t = 0; t < trains; ++t) {
    for (int w = 0; w < 4; ++w) words[w * trains + t] = train_at(t).bits[w];
  }
  for (size_t q = 0; q < queries; ++q) {
    uint64_t two_best[2];
    HWY_DYNAMIC_DISPATCH(find_two_best)
    (query_at(q), static_cast<int>(q), words.data(), static_cast<int>(trains), two_best,
     best_of_train->data());
    for (const uint64_t rank : two_best) (*of_query)[q].offer(rank);
  }
}

void take_mutual(std::span<const TwoRanks> of_query, std::span<const uint64_t> best_of_train, float max_ratio,
                 std::vector<DescriptorMatch>* matches) {
  for (size_t q = 0; q < of_query.size(); ++q) {
    const auto [best, second] = of_query[q];
    if (index_of(best_of_train[index_of(best)]) != q) continue;
    if (distance_of(best) >= max_ratio * distance_of(second)) continue;
    matches->push_back({static_cast<int>(q), static_cast<int>(index_of(best)), static_cast<int>(best >> 32)});
  }
}

}  // namespace

void match_descriptors(std::span<const Descriptor> query, std::span<const Descriptor> train, float max_ratio,
                       std::vector<DescriptorMatch>* matches) {
  matches->clear();
  if (train.empty()) return;
  std::vector<TwoRanks> of_query(query.size());
  std::vector<uint64_t> best_of_train(train.size(), kNone);
  rank_both_ways(
      query.size(), train.size(), [&](size_t q) -> const Descriptor& { return query[q]; },
      [&](size_t t) -> const Descriptor& { return train[t]; }, &of_query, &best_of_train);
  take_mutual(of_query, best_of_train, max_ratio, matches);
}

void match_descriptors(std::span<const UprightDescriptor> query, std::span<const UprightDescriptor> train,
                       float max_ratio, std::vector<DescriptorMatch>* matches) {
  matches->clear();
  if (train.empty()) return;
  std::vector<TwoRanks> of_query(query.size());
  std::vector<uint64_t> best_of_train(train.size(), kNone);
  for (int a = 0; a < kUprightSizes; ++a) {
    for (int b = 0; b < kUprightSizes; ++b) {
      rank_both_ways(
          query.size(), train.size(), [&](size_t q) -> const Descriptor& { return query[q][a]; },
          [&](size_t t) -> const Descriptor& { return train[t][b]; }, &of_query, &best_of_train);
    }
  }
  take_mutual(of_query, best_of_train, max_ratio, matches);
}

}  // namespace raysfm
#endif  // HWY_ONCE
