#pragma once

#include <Eigen/Core>
#include <array>
#include <span>
#include <vector>

#include "raysfm/projective/view_pair.h"
#include "raysfm/robust/ransac.h"

namespace raysfm {

// An estimator of ransac() for a 3x3 matrix between two images. `Relation` says which:
//   kSampleSize                        matches that determine it
//   kRounds                            fits to the inliers of the one before that follow a new best
//   bool fit(a, b, Matrix3d*)          to kSampleSize or more matches
//   double error2(Matrix3d, a, b)      squared distance of a match to it
template <typename Relation>
class MatchEstimator {
 public:
  using Model = Eigen::Matrix3d;
  static constexpr int kSampleSize = Relation::kSampleSize, kMaxModels = 1;

  // The matches must outlive the object; `max_error` in their unit.
  MatchEstimator(const PairMatches& matches, double max_error)
      : matches_(matches), max_error2_(max_error * max_error) {}

  int size() const { return static_cast<int>(matches_.a.size()); }
  bool sample(Rng& rng, std::array<int, kSampleSize>* sample) const {
    draw_sample(rng, size(), sample);
    return true;
  }
  int generate(const std::array<int, kSampleSize>& sample, std::array<Model, kMaxModels>* models) const {
    std::array<Eigen::Vector2d, kSampleSize> a, b;
    for (int i = 0; i < kSampleSize; ++i) a[i] = matches_.a[sample[i]], b[i] = matches_.b[sample[i]];
    return Relation::fit(a, b, models->data()) ? 1 : 0;
  }
  RansacScore score(const Model& model, double limit) const {
    return truncated_score(size(), limit, [&](int i) { return error2(model, i) / max_error2_; });
  }
  void refine(Model* model) {
    for (int round = 0; round < Relation::kRounds; ++round) {
      kept_a_.clear(), kept_b_.clear();
      for (int i = 0; i < size(); ++i) {
        if (!(error2(*model, i) < max_error2_)) continue;
        kept_a_.push_back(matches_.a[i]);
        kept_b_.push_back(matches_.b[i]);
      }
      Model better;
      if (!Relation::fit(kept_a_, kept_b_, &better)) return;
      *model = better;
    }
  }

 private:
  double error2(const Model& model, int i) const {
    return Relation::error2(model, matches_.a[i], matches_.b[i]);
  }

  const PairMatches& matches_;
  const double max_error2_;
  std::vector<Eigen::Vector2d> kept_a_, kept_b_;
};

}  // namespace raysfm
