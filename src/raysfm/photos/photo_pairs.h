#pragma once

#include <atomic>
#include <cstdint>
#include <span>
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

// Pairs of photos with their matches, of ratios up to kLooseRatio.
struct MatchedPairs {
  std::vector<std::pair<int, int>> photos;
  std::vector<std::vector<PhotoMatch>> matches;  // one per pair
};

// Once `stop` is set the rest has none. The same on any number of threads.
MatchedPairs match_pairs(const PhotoFeatures& features, std::vector<std::pair<int, int>> pairs,
                         const std::atomic<bool>* stop, ThreadPool* pool);

// Points of two photos that are one by an epipolar geometry: the number of the point in each; empty where
// there is no such geometry.
using SamePoints = std::vector<std::pair<int, int>>;

// How pairs are compared.
struct PairOptions {
  const Camera* camera = nullptr;  // the central one that took all photos, which makes it a matter of rays
  double max_error_px = 3.0;       // of an inlier, > 0
  float max_ratio = kClearRatio;   // of a match, up to kLooseRatio
  std::span<const uint8_t> posed = {};  // photos two of which are not compared, one mark each; empty: all are
  uint64_t seed = 0;
  const std::atomic<bool>* stop = nullptr;  // set: the rest is empty
};

// Which points of each pair are one; the same on any number of threads.
std::vector<SamePoints> compare_pairs(const PhotoFeatures& features, const MatchedPairs& pairs,
                                      const PairOptions& options, ThreadPool* pool);

}  // namespace raysfm
