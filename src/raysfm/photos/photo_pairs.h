#pragma once

#include <atomic>
#include <cstdint>
#include <utility>
#include <vector>

#include "raysfm/camera/camera.h"
#include "raysfm/core/thread_pool.h"
#include "raysfm/matching/photo_features.h"

namespace raysfm {

// Most photos of which every one is compared with every other.
inline constexpr int kMostInAllPairs = 60;

// Ratios of a match (PhotoFeatures::match()). What repeats, a carpet's pattern or a row of windows, is
// matched with its likes, and such matches agree with one another: of pairs that share nothing but a carpet
// up to 190 of 240 matches at 0.8 make an epipolar geometry that is none. Most of these are above 0.65, most
// right ones below. Photos that show too little that is clear are compared again, with what has been
// reconstructed.
inline constexpr float kClearRatio = 0.65f, kLooseRatio = 0.8f;

// Pairs of photos that are worth a comparison, first < second, ascending: all of a few; of more, those that
// look alike (places/place_index), and those that were taken one after the other.
std::vector<std::pair<int, int>> pairs_to_compare(const PhotoFeatures& features, ThreadPool* pool);

// Points of two photos that are one by an epipolar geometry: the number of the point in each; empty where
// there is no such geometry.
using SamePoints = std::vector<std::pair<int, int>>;

// How pairs are compared.
struct PairOptions {
  const Camera* camera = nullptr;  // the central one that took all photos, which makes it a matter of rays
  double max_error_px = 3.0;       // of an inlier, > 0
  float max_ratio = kClearRatio;   // of a match: see PhotoFeatures::match()
  uint64_t seed = 0;
  const std::atomic<bool>* stop = nullptr;  // set: the rest is empty
};

// Compares the pairs; one answer each, the same on any number of threads.
std::vector<SamePoints> compare_pairs(const PhotoFeatures& features,
                                      const std::vector<std::pair<int, int>>& pairs,
                                      const PairOptions& options, ThreadPool* pool);

}  // namespace raysfm
