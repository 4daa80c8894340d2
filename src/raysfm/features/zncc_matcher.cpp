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

// Appends to `found` the elements of indices[begin..end) whose pixel lies within the radius, and returns how
// many; writes up to a vector behind the last.
int find_within(const FeatureGrid& grid, int begin, int end, float x, float y, float radius2, int* found) {
  const hn::CappedTag<float, FeatureGrid::kReadable> floats;
  const hn::RebindToSigned<decltype(floats)> ints;
  const int lanes = static_cast<int>(hn::Lanes(floats));
  const auto centre_x = hn::Set(floats, x), centre_y = hn::Set(floats, y), limit = hn::Set(floats, radius2);
  int count = 0;
  for (int k = begin; k < end; k += lanes) {
    const auto dx = hn::Sub(hn::LoadU(floats, grid.xs() + k), centre_x);
    const auto dy = hn::Sub(hn::LoadU(floats, grid.ys() + k), centre_y);
    const auto near = hn::Le(hn::Add(hn::Mul(dx, dx), hn::Mul(dy, dy)), limit);
    const auto mask =
        hn::And(hn::RebindMask(ints, near), hn::FirstN(ints, static_cast<size_t>(std::min(end - k, lanes))));
    count += static_cast<int>(
        hn::CompressBlendedStore(hn::LoadU(ints, grid.indices() + k), mask, ints, found + count));
  }
  return count;
}

// scores[c] = ZNCC of a patch with patch candidates[c] of `train`. The sums are exact, so their order does
// not matter.
void score_candidates(const int8_t* query, float query_inverse_norm, const PatchSet& train,
                      const int* candidates, int count, float* scores) {
#if HWY_TARGET == HWY_SCALAR
  for (int c = 0; c < count; ++c) {
    const int8_t* patch = train.patch(candidates[c]);
    int32_t dot = 0;
    for (int k = 0; k < kPatchStride; ++k) dot += query[k] * patch[k];
    scores[c] = static_cast<float>(dot) * (query_inverse_norm * train.inverse_norm(candidates[c]));
  }
#else
  const hn::ScalableTag<int16_t> d16;
  const hn::Rebind<int8_t, decltype(d16)> d8;
  const hn::RepartitionToWide<decltype(d16)> d32;
  const int lanes = static_cast<int>(hn::Lanes(d16));
  for (int c = 0; c < count; ++c) {
    const int8_t* patch = train.patch(candidates[c]);
    auto even = hn::Zero(d32), odd = hn::Zero(d32);
    for (int k = 0; k < kPatchStride; k += lanes) {
      const auto a = hn::PromoteTo(d16, hn::Load(d8, query + k));
      const auto b = hn::PromoteTo(d16, hn::Load(d8, patch + k));
      even = hn::ReorderWidenMulAccumulate(d32, a, b, even, odd);
    }
    const int32_t dot = hn::GetLane(hn::SumOfLanes(d32, hn::Add(even, odd)));
    scores[c] = static_cast<float>(dot) * (query_inverse_norm * train.inverse_norm(candidates[c]));
  }
#endif
}

}  // namespace HWY_NAMESPACE
}  // namespace raysfm
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace raysfm {

HWY_EXPORT(find_within);
HWY_EXPORT(score_candidates);

namespace {

// A score and the index it belongs to, ordered by score (positive floats compare like their bits), equal ones
// the lower index first. Zero stands for none. The greatest is kept without a branch, which would be
// mispredicted every time that a new best appears.
uint64_t rank(float score, int index) {
  return uint64_t{std::bit_cast<uint32_t>(std::max(score, 0.0f))} << 32 | ~static_cast<uint32_t>(index);
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
  candidates_.resize(train_pixels.size() + FeatureGrid::kReadable);
  scores_.resize(train_pixels.size());

  for (int q = 0; q < query.size(); ++q) {
    const float radius = radius_px[q];
    if (!query.valid(q) || !(radius > 0)) continue;
    int count = 0;
    train_grid.for_each_run(predicted[q], radius, [&](int begin, int end) {
      count += HWY_DYNAMIC_DISPATCH(find_within)(train_grid, begin, end, predicted[q].x(), predicted[q].y(),
                                                 radius * radius, candidates_.data() + count);
    });
    HWY_DYNAMIC_DISPATCH(score_candidates)
    (query.patch(q), query.inverse_norm(q), train, candidates_.data(), count, scores_.data());
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
