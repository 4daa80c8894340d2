#include "raysfm/photos/photo_points.h"

#include "raysfm/core/disjoint_sets.h"

namespace raysfm {
namespace {

void join_tracks(const PhotoPoints& points, DisjointSets* sets) {
  std::vector<int> last(points.tracks, -1);
  for (int i = 0; i < static_cast<int>(points.track.size()); ++i) {
    if (points.track[i] < 0) continue;
    int& before = last[points.track[i]];
    if (before >= 0) sets->join(before, i);
    before = i;
  }
}

// By the root of a set: how many points it has, -1 for one with two of a photo.
std::vector<int> sizes_of_sets(const PhotoPoints& points, DisjointSets* sets) {
  std::vector<int> last_photo(points.rgb.size(), -1), size(points.rgb.size(), 0);
  for (int j = 0; j < points.features->photos(); ++j) {
    for (size_t i = 0; i < points.features->pixels(j).size(); ++i) {
      const int root = sets->root(points.first[j] + static_cast<int>(i));
      size[root] = last_photo[root] == j || size[root] < 0 ? -1 : size[root] + 1;
      last_photo[root] = j;
    }
  }
  return size;
}

}  // namespace

void join_same_points(std::span<const std::pair<int, int>> pairs, std::span<const SamePoints> same,
                      PhotoPoints* points) {
  const int count = static_cast<int>(points->rgb.size());
  DisjointSets sets(count);
  join_tracks(*points, &sets);
  for (size_t i = 0; i < pairs.size(); ++i) {
    for (const auto& [in_a, in_b] : same[i]) {
      sets.join(points->first[pairs[i].first] + in_a, points->first[pairs[i].second] + in_b);
    }
  }
  const std::vector<int> size = sizes_of_sets(*points, &sets);
  std::vector<int> number(count, -1);
  points->track.assign(count, -1);
  points->tracks = 0;
  for (int i = 0; i < count; ++i) {
    const int root = sets.root(i);
    if (size[root] < 2) continue;
    if (number[root] < 0) number[root] = points->tracks++;
    points->track[i] = number[root];
  }
}

std::vector<int> tracks_now(const PhotoPoints& before, const PhotoPoints& now) {
  std::vector<int> number(before.tracks, -1);
  for (size_t i = 0; i < before.track.size(); ++i) {
    if (before.track[i] >= 0) number[before.track[i]] = now.track[i];
  }
  return number;
}

}  // namespace raysfm
