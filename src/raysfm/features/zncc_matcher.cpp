#include "raysfm/features/zncc_matcher.h"

#include <algorithm>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "raysfm/features/zncc_matcher.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace raysfm {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

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

HWY_EXPORT(score_candidates);

void ZnccMatcher::match(const PatchSet& query, std::span<const Eigen::Vector2f> predicted,
                        std::span<const float> radius_px, const PatchSet& train,
                        std::span<const Eigen::Vector2f> train_pixels, const FeatureGrid& train_grid,
                        const ZnccOptions& options, std::vector<ZnccMatch>* matches) {
  matches->clear();
  best_of_query_.assign(query.size(), {0, 0, -1});
  best_of_train_.assign(train.size(), {0, 0, -1});
  candidates_.resize(train_pixels.size());
  scores_.resize(train_pixels.size());

  const auto take = [](Best& best, float score, int index) {
    if (score > best.zncc) {
      best.second = best.zncc;
      best.zncc = score;
      best.index = index;
    } else if (score > best.second) {
      best.second = score;
    }
  };
  for (int q = 0; q < query.size(); ++q) {
    if (!query.valid(q) || !(radius_px[q] > 0)) continue;
    int count = 0;
    train_grid.for_each_in(predicted[q], radius_px[q], [&](int t) { candidates_[count++] = t; });
    HWY_DYNAMIC_DISPATCH(score_candidates)
    (query.patch(q), query.inverse_norm(q), train, candidates_.data(), count, scores_.data());
    for (int c = 0; c < count; ++c) {
      take(best_of_query_[q], scores_[c], candidates_[c]);
      take(best_of_train_[candidates_[c]], scores_[c], q);
    }
  }

  for (int q = 0; q < query.size(); ++q) {
    const Best& best = best_of_query_[q];
    if (best.index < 0 || best.zncc < options.min_zncc) continue;
    if (best_of_train_[best.index].index != q) continue;
    if (1 - best.zncc > options.max_distance_ratio * (1 - best.second)) continue;
    matches->push_back({q, best.index, std::min(best.zncc, 1.0f)});
  }
}

}  // namespace raysfm
#endif  // HWY_ONCE
