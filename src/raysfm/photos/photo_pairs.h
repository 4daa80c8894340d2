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

// Pairs of photos that are worth a comparison, first < second, ascending: all of a few; of more, those that
// look alike (places/place_index), and those that were taken one after the other.
std::vector<std::pair<int, int>> pairs_to_compare(const PhotoFeatures& features, ThreadPool* pool);

// Points of two photos that are one by an epipolar geometry: the number of the point in each; empty where
// there is no such geometry.
using SamePoints = std::vector<std::pair<int, int>>;

// Compares the pairs; one answer each, the same on any number of threads. `camera`: the central one that all
// photos were taken with, which makes it a matter of rays, or null. `stop`: set or null; the rest is empty
// then.
std::vector<SamePoints> compare_pairs(const PhotoFeatures& features,
                                      const std::vector<std::pair<int, int>>& pairs, const Camera* camera,
                                      double max_error_px, uint64_t seed, const std::atomic<bool>* stop,
                                      ThreadPool* pool);

}  // namespace raysfm
