#include "raysfm/features/zncc_matcher.h"

#include <algorithm>
#include <bit>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "raysfm/features/zncc_matcher.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace raysfm {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

const hn::CappedTag<float, FeatureGrid::kBeyond> kPlaces;

// Writes the indices of the pixels within the radius to `found`, with room for FeatureGrid::kBeyond behind
// the last, and returns how many. Without branches, since nearly half of the tests fail.
int find_within(const FeatureGrid& grid, const Eigen::Vector2f& centre, float radius,
                int* HWY_RESTRICT found) {
  const hn::Rebind<int32_t, decltype(kPlaces)> ints;
  const int lanes = static_cast<int>(hn::Lanes(kPlaces));
  const auto x = hn::Set(kPlaces, centre.x()), y = hn::Set(kPlaces, centre.y());
  const auto limit = hn::Set(kPlaces, radius * radius);
  const float *xs = grid.xs(), *ys = grid.ys();
  const int* indices = grid.indices();
  size_t count = 0;
  grid.for_each_run(centre, radius, [&](int begin, int end) HWY_ATTR {
    for (int k = begin; k < end; k += lanes) {
      const auto dx = hn::Sub(hn::LoadU(kPlaces, xs + k), x), dy = hn::Sub(hn::LoadU(kPlaces, ys + k), y);
      const auto is_near = hn::Le(hn::Add(hn::Mul(dx, dx), hn::Mul(dy, dy)), limit);
      const auto is_of_run = hn::FirstN(kPlaces, static_cast<size_t>(end - k));
      const auto both = hn::RebindMask(ints, hn::And(is_near, is_of_run));
      hn::StoreU(hn::Compress(hn::LoadU(ints, indices + k), both), ints, found + count);
      count += hn::CountTrue(ints, both);
    }
  });
  return static_cast<int>(count);
}

#if HWY_TARGET != HWY_SCALAR && !HWY_HAVE_SCALABLE
// The sum of the blocks of a vector, each of four lanes.
template <class D, class V>
HWY_INLINE auto SumOfBlocks(D d, V v) {
  if constexpr (hn::MaxLanes(d) <= 4) {
    return v;
  } else {
    const hn::Half<D> half;
    return SumOfBlocks(half, hn::Add(hn::LowerHalf(half, v), hn::UpperHalf(half, v)));
  }
}

// The sums of the lanes of four vectors: fewer shuffles than one after another.
template <class D, class V>
HWY_INLINE void SumEach(D d, V a, V b, V c, V e, int32_t* sums) {
  const hn::RepartitionToWide<D> pairs;
  const auto ab = hn::BitCast(pairs, hn::Add(hn::InterleaveLower(d, a, b), hn::InterleaveUpper(d, a, b)));
  const auto ce = hn::BitCast(pairs, hn::Add(hn::InterleaveLower(d, c, e), hn::InterleaveUpper(d, c, e)));
  const auto all = hn::Add(hn::BitCast(d, hn::InterleaveLower(pairs, ab, ce)),
                           hn::BitCast(d, hn::InterleaveUpper(pairs, ab, ce)));
  hn::Store(SumOfBlocks(d, all), hn::CappedTag<int32_t, 4>(), sums);
}
#endif

// scores[c] = ZNCC of patch `q` of the queries with patch candidates[c] of `train`, zero where negative. The
// sums are exact, so their order does not matter.
void score_candidates(const PatchSet& query, int q, const PatchSet& train, const int* candidates, int count,
                      float* HWY_RESTRICT scores) {
  const float inverse_norm = query.inverse_norm(q);
  alignas(64) int16_t wide[kPatchStride];
  for (int k = 0; k < kPatchStride; ++k) wide[k] = query.patch(q)[k];
#if HWY_TARGET == HWY_SCALAR
  for (int c = 0; c < count; ++c) {
    int32_t dot = 0;
    for (int k = 0; k < kPatchStride; ++k) dot += wide[k] * train.patch(candidates[c])[k];
    scores[c] = static_cast<float>(std::max(dot, 0)) * (inverse_norm * train.inverse_norm(candidates[c]));
  }
#else
  const hn::ScalableTag<int16_t> d16;
  const hn::Rebind<int8_t, decltype(d16)> d8;
  const hn::RepartitionToWide<decltype(d16)> d32;
  const int lanes = static_cast<int>(hn::Lanes(d16));
  // Lanes that sum up to the product with a candidate.
  const auto products = [&](int candidate) HWY_ATTR {
    const int8_t* patch = train.patch(candidate);
    auto even = hn::Zero(d32), odd = hn::Zero(d32);
    for (int k = 0; k < kPatchStride; k += lanes) {
      const auto b = hn::PromoteTo(d16, hn::Load(d8, patch + k));
      even = hn::ReorderWidenMulAccumulate(d32, hn::Load(d16, wide + k), b, even, odd);
    }
    return hn::Add(even, odd);
  };
  // Half of all scores are negative: a branch on the sign would be mispredicted.
  const auto score = [&](int32_t dot, int candidate) {
    return static_cast<float>(std::max(dot, 0)) * (inverse_norm * train.inverse_norm(candidate));
  };
  int c = 0;
#if !HWY_HAVE_SCALABLE
  constexpr int kAtOnce = 4;
  for (; c + kAtOnce <= count; c += kAtOnce) {
    const int* at = candidates + c;
    alignas(16) int32_t dots[kAtOnce];
    SumEach(d32, products(at[0]), products(at[1]), products(at[2]), products(at[3]), dots);
    for (int i = 0; i < kAtOnce; ++i) scores[c + i] = score(dots[i], at[i]);
  }
#endif
  for (; c < count; ++c) {
    scores[c] = score(hn::GetLane(hn::SumOfLanes(d32, products(candidates[c]))), candidates[c]);
  }
#endif
}

// Both of the above; returns the number of candidates.
int score_region(const PatchSet& query, int q, const Eigen::Vector2f& centre, float radius,
                 const PatchSet& train, const FeatureGrid& grid, int* candidates, float* scores) {
  const int count = find_within(grid, centre, radius, candidates);
  score_candidates(query, q, train, candidates, count, scores);
  return count;
}

}  // namespace HWY_NAMESPACE
}  // namespace raysfm
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace raysfm {

HWY_EXPORT(score_region);

namespace {

// A score and the index it belongs to, ordered by score (floats that are not negative compare like
// their bits), equal ones
// the lower index first. Zero stands for none. The greatest is kept without a branch, which would be
// mispredicted every time that a new best appears.
uint64_t rank(float score, int index) {
  return uint64_t{std::bit_cast<uint32_t>(score)} << 32 | ~static_cast<uint32_t>(index);
}
float score_of(uint64_t rank) {
  return std::bit_cast<float>(static_cast<uint32_t>(rank >> 32));
}
int index_of(uint64_t rank) {
  return static_cast<int>(~static_cast<uint32_t>(rank));
}

}  // namespace

void ZnccMatcher::match(const PatchSet& query, std::span<const Eigen::Vector2f> predicted,
                        std::span<const float> radius_px, const PatchSet& train,
                        std::span<const Eigen::Vector2f> train_pixels, const FeatureGrid& train_grid,
                        const ZnccOptions& options, std::vector<ZnccMatch>* matches) {
  matches->clear();
  best_of_query_.assign(query.size(), 0);
  second_of_query_.assign(query.size(), 0);
  best_of_train_.assign(train.size(), 0);
  candidates_.resize(train_pixels.size() + FeatureGrid::kBeyond);
  scores_.resize(train_pixels.size());

  for (int q = 0; q < query.size(); ++q) {
    const float radius = radius_px[q];
    if (!query.valid(q) || !(radius > 0)) continue;
    const int count = HWY_DYNAMIC_DISPATCH(score_region)(query, q, predicted[q], radius, train, train_grid,
                                                         candidates_.data(), scores_.data());
    uint64_t best = 0;
    float second = 0;
    for (int c = 0; c < count; ++c) {
      const int t = candidates_[c];
      const uint64_t as_seen_by_query = rank(scores_[c], t);
      second = std::max(second, std::min(score_of(best), scores_[c]));
      best = std::max(best, as_seen_by_query);
      best_of_train_[t] = std::max(best_of_train_[t], rank(scores_[c], q));
    }
    best_of_query_[q] = best;
    second_of_query_[q] = second;
  }

  for (int q = 0; q < query.size(); ++q) {
    const float best = score_of(best_of_query_[q]);
    if (!(best > 0) || best < options.min_zncc) continue;
    const int t = index_of(best_of_query_[q]);
    if (index_of(best_of_train_[t]) != q) continue;
    if (1 - best > options.max_distance_ratio * (1 - second_of_query_[q])) continue;
    matches->push_back({q, t, std::min(best, 1.0f)});
  }
}

}  // namespace raysfm
#endif  // HWY_ONCE
