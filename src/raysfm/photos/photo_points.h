#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "raysfm/matching/photo_features.h"
#include "raysfm/photos/photo_pairs.h"

namespace raysfm {

// The interest points of all photos in one row, photo after photo, and which of them are one.
struct PhotoPoints {
  std::shared_ptr<PhotoFeatures> features;
  std::shared_ptr<const MatchedPairs> pairs;  // those that were compared; null: none was
  std::vector<int> first;                     // point of each photo
  std::vector<std::array<uint8_t, 3>> rgb;    // one per point
  std::vector<int> track;                     // one per point: the number of its track, -1: it has none
  int tracks = 0;
};

// Makes one what is the same in pairs of photos, along with what has been one before. Sets of at least two
// points become tracks, numbered in the order of their first points. One with two points of a photo is two,
// and which is which is not known: it becomes none.
void join_same_points(std::span<const std::pair<int, int>> pairs, std::span<const SamePoints> same,
                      PhotoPoints* points);

// By track before: the track that its points belong to now, -1 for one that is none any more.
std::vector<int> tracks_now(const PhotoPoints& before, const PhotoPoints& now);

}  // namespace raysfm
