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
constexpr int kMargin = 8;       // pixels by which a disc may leave the picture
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

// The tests in every direction.
std::array<std::array<Test, kTests>, kDirections> make_pattern() {
  constexpr int kMinDistance = 3;
  std::array<std::array<Test, kTests>, kDirections> pattern;
  Rng rng(2);
  for (int i = 0; i < kTests; ++i) {
    Offset a, b, apart;
    do {
      a = draw_point(rng), b = draw_point(rng);
      apart = {a.x - b.x, a.y - b.y};
    } while (apart.x * apart.x + apart.y * apart.y < kMinDistance * kMinDistance);
    for (int d = 0; d < kDirections; ++d) {
      const auto round = [](int v) {
        return static_cast<int8_t>((v + (v < 0 ? -kFixed / 2 : kFixed / 2)) / kFixed);
      };
      const auto x = [&](const Offset& p) { return round(kUnit[d].x * p.x - kUnit[d].y * p.y); };
      const auto y = [&](const Offset& p) { return round(kUnit[d].y * p.x + kUnit[d].x * p.y); };
      pattern[d][i] = {x(a), y(a), x(b), y(b)};
    }
  }
  return pattern;
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

Descriptor describe_at(const GrayView& image, int x, int y) {
  static const auto kPattern = make_pattern();
  const std::array<Test, kTests>& tests = kPattern[direction_at(image, x, y)];
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
  out->corners.clear();
  out->descriptors.clear();
  smooth_.clear();
  smooth_.resize(picture.last() + 1);
  for (size_t i = 0; i < pixels.size(); ++i) {
    // The next coarser one: twice the disc tells more than twice the detail.
    const int octave = picture.clamp(octaves[i] + 1);
    const GrayImage& image = smooth(picture, octave);
    const Eigen::Vector2f place = into_octave(pixels[i], octave);
    const int x = kMargin + static_cast<int>(std::lround(place.x()));
    const int y = kMargin + static_cast<int>(std::lround(place.y()));
    if (x < kRadius || y < kRadius || x + kRadius >= image.width() || y + kRadius >= image.height()) continue;
    out->corners.push_back(static_cast<int>(i));
    out->descriptors.push_back(describe_at(image, x, y));
  }
}

void match_descriptors(std::span<const Descriptor> query, std::span<const Descriptor> train, float max_ratio,
                       std::vector<DescriptorMatch>* matches) {
  matches->clear();
  if (train.empty()) return;
  const int size = static_cast<int>(train.size());
  std::vector<uint64_t> words(4 * train.size()), two_best(2 * query.size());
  std::vector<uint64_t> best_of_train(train.size(), std::numeric_limits<uint64_t>::max());
  for (int t = 0; t < size; ++t) {
    for (int w = 0; w < 4; ++w) words[w * size + t] = train[t].bits[w];
  }
  for (size_t q = 0; q < query.size(); ++q) {
    HWY_DYNAMIC_DISPATCH(find_two_best)
    (query[q], static_cast<int>(q), words.data(), size, &two_best[2 * q], best_of_train.data());
  }
  const auto index_of = [](uint64_t rank) { return static_cast<int>(static_cast<uint32_t>(rank)); };
  const auto distance_of = [](uint64_t rank) { return static_cast<float>(rank >> 32); };
  for (int q = 0; q < static_cast<int>(query.size()); ++q) {
    const uint64_t best = two_best[2 * q], second = two_best[2 * q + 1];
    if (index_of(best_of_train[index_of(best)]) != q) continue;
    if (distance_of(best) >= max_ratio * distance_of(second)) continue;
    matches->push_back({q, index_of(best), static_cast<int>(best >> 32)});
  }
}

}  // namespace raysfm
#endif  // HWY_ONCE
