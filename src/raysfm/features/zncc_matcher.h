#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <vector>

#include "raysfm/features/feature_grid.h"
#include "raysfm/features/patches.h"

namespace raysfm {

// Patch `query` of one set looks like `train` of the other.
struct ZnccMatch {
  int query = -1;
  int train = -1;
  float zncc = 0;  // in [min_zncc, 1]
};

struct ZnccOptions {
  float min_zncc = 0.7f;  // in (0, 1]
  // A match is dropped when (1 - zncc) of the best exceeds this part of (1 - zncc) of the second best
  // candidate of its query. 1 keeps all.
  float max_distance_ratio = 1.0f;
};

// Matches patches of two images by zero-mean normalised cross-correlation inside a region of interest; each
// is matched once, to the one that it prefers and that prefers it (LBA09 2.1, winner takes all, both ways).
// Owns its scratch memory: one matcher serves one thread at a time.
class ZnccMatcher {
 public:
  // `predicted` and `radius_px` (radius of the region of interest, pixels) have one element per query patch;
  // `train_pixels` one per train patch, and `train_grid` was built from it. A query with a radius <= 0 or a
  // place that is not finite takes no part. Matches come in the order of the queries; ties go to the lower
  // index.
  void match(const PatchSet& query, std::span<const Eigen::Vector2f> predicted,
             std::span<const float> radius_px, const PatchSet& train,
             std::span<const Eigen::Vector2f> train_pixels, const FeatureGrid& train_grid,
             const ZnccOptions& options, std::vector<ZnccMatch>* matches);

 private:
  std::vector<uint64_t> best_of_query_, best_of_train_;  // score and partner in one number, see the source
  std::vector<float> second_of_query_;
  std::vector<int> candidates_;
  std::vector<float> scores_;
};

}  // namespace raysfm
