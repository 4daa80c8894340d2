#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <concepts>
#include <cstdint>
#include <limits>
#include <vector>

#include "raysfm/core/random.h"

namespace raysfm {

struct RansacOptions {
  int min_iterations = 10;    // samples drawn whatever the inlier ratio
  int max_iterations = 1000;  // samples drawn at most
  double confidence = 0.999;  // that at least one sample was free of outliers, in (0, 1)
  uint64_t seed = 0;
  uint64_t stream = 0;  // separates uses of one seed, e.g. the index of the frame
};

// Truncated quadratic cost: sum over the data of min(1, (error / threshold)^2), and the data below 1.
struct RansacScore {
  double cost = std::numeric_limits<double>::infinity();
  int inliers = 0;
};

// The score of a model over `size` data, of which `share2(i)` is (error / threshold)^2 of one; what is not a
// number counts as an outlier. Infinite where no datum agrees, and where the cost exceeds `limit`, which is
// looked at every few data.
template <typename SquaredShare>
RansacScore truncated_score(int size, double limit, SquaredShare share2) {
  constexpr int kBlock = 16;
  RansacScore score{.cost = 0, .inliers = 0};
  for (int begin = 0; begin < size; begin += kBlock) {
    for (int i = begin; i < std::min(begin + kBlock, size); ++i) {
      const double share = share2(i);
      score.inliers += share < 1;
      score.cost += share < 1 ? share : 1.0;
    }
    if (score.cost > limit) return {};
  }
  return score.inliers > 0 ? score : RansacScore{};
}

// Keeps about `most` of the indices, evenly spread.
inline void thin_out(std::size_t most, std::vector<int>* indices) {
  const std::size_t stride = (indices->size() + most - 1) / most;
  if (stride < 2) return;
  std::size_t kept = 0;
  for (std::size_t i = 0; i < indices->size(); i += stride) (*indices)[kept++] = (*indices)[i];
  indices->resize(kept);
}

struct RansacReport {
  int iterations = 0;   // samples drawn
  int refinements = 0;  // local optimisations
  RansacScore score;    // of the returned model; infinite cost when there is none
  bool found() const { return std::isfinite(score.cost); }
};

// What the loop needs to know about a model. `sample` draws kSampleSize indices (the estimator knows which
// may be combined; false when it cannot), `generate` writes hypotheses and returns how many, `score` may stop
// and return an infinite cost once the cost exceeds `limit`, `refine` improves a model on its inliers.
template <typename E>
concept RansacEstimator = requires(E e, const E c, typename E::Model* m, const typename E::Model& model,
                                   Rng& rng, std::array<int, E::kSampleSize>* sample,
                                   std::array<typename E::Model, E::kMaxModels>* models) {
  { c.size() } -> std::convertible_to<int>;
  { c.sample(rng, sample) } -> std::convertible_to<bool>;
  { e.generate(*sample, models) } -> std::convertible_to<int>;
  { e.score(model, 0.0) } -> std::convertible_to<RansacScore>;
  e.refine(m);
};

// Draws N different indices below `size` >= N.
template <std::size_t N>
void draw_sample(Rng& rng, int size, std::array<int, N>* sample) {
  for (std::size_t i = 0; i < N; ++i) {
    const auto begin = sample->begin(), end = begin + i;
    do (*sample)[i] = static_cast<int>(rng.index(static_cast<uint32_t>(size)));
    while (std::find(begin, end, (*sample)[i]) != end);
  }
}

// Samples after which, with the given confidence, one was free of outliers.
inline double ransac_iterations_needed(double inlier_ratio, int sample_size, double confidence) {
  const double all_inliers = std::pow(inlier_ratio, sample_size);
  if (all_inliers <= 0) return std::numeric_limits<double>::infinity();
  if (all_inliers >= 1) return 0;
  return std::log1p(-confidence) / std::log1p(-all_inliers);
}

// RANSAC with a truncated quadratic score (Torr and Zisserman 2000) and local optimisation of every new best
// model (Chum, Matas and Kittler 2003). Starts from `*best` when its score is given. Allocates nothing.
template <RansacEstimator E>
RansacReport ransac(E& estimator, const RansacOptions& options, typename E::Model* best,
                    RansacScore start = {}) {
  Rng rng(options.seed, options.stream);
  RansacReport report{.score = start};
  std::array<int, E::kSampleSize> sample;
  std::array<typename E::Model, E::kMaxModels> models;
  const auto needed = [&] {
    const double ratio = static_cast<double>(report.score.inliers) / estimator.size();
    return std::clamp(ransac_iterations_needed(ratio, E::kSampleSize, options.confidence),
                      double(options.min_iterations), double(options.max_iterations));
  };
  const auto take_if_better = [&](const typename E::Model& model) {
    const RansacScore score = estimator.score(model, report.score.cost);
    if (!(score.cost < report.score.cost)) return false;
    report.score = score;
    *best = model;
    return true;
  };

  if (estimator.size() < E::kSampleSize) return report;
  for (double limit = needed(); report.iterations < limit; ++report.iterations) {
    if (!estimator.sample(rng, &sample)) continue;
    const int count = estimator.generate(sample, &models);
    bool improved = false;
    for (int i = 0; i < count; ++i) improved |= take_if_better(models[i]);
    if (!improved) continue;
    typename E::Model refined = *best;
    estimator.refine(&refined);
    take_if_better(refined);
    ++report.refinements;
    limit = needed();
  }
  return report;
}

}  // namespace raysfm
