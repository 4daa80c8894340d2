#include "raysfm/photos/photo_points.h"

#include <numeric>

namespace raysfm {
namespace {

// Sets of points that are one.
class Merger {
 public:
  explicit Merger(int count) : parent_(count) { std::iota(parent_.begin(), parent_.end(), 0); }
  int root(int i) {
    while (parent_[i] != i) i = parent_[i] = parent_[parent_[i]];
    return i;
  }
  void join(int i, int j) { parent_[root(i)] = root(j); }

 private:
  std::vector<int> parent_;
};

void join_tracks(const PhotoPoints& points, Merger* merger) {
  std::vector<int> last(points.tracks, -1);
  for (int i = 0; i < static_cast<int>(points.track.size()); ++i) {
    if (points.track[i] < 0) continue;
    int& before = last[points.track[i]];
    if (before >= 0) merger->join(before, i);
    before = i;
  }
}

// By the root of a set: how many points it has, -1 for one with two of a photo.
std::vector<int> sizes_of_sets(const PhotoPoints& points, Merger* merger) {
  std::vector<int> last_photo(points.rgb.size(), -1), size(points.rgb.size(), 0);
  for (int j = 0; j < points.features->photos(); ++j) {
    for (size_t i = 0; i < points.features->pixels(j).size(); ++i) {
      const int root = merger->root(points.first[j] + static_cast<int>(i));
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
  Merger merger(count);
  join_tracks(*points, &merger);
  for (size_t i = 0; i < pairs.size(); ++i) {
    for (const auto& [in_a, in_b] : same[i]) {
      merger.join(points->first[pairs[i].first] + in_a, points->first[pairs[i].second] + in_b);
    }
  }
  const std::vector<int> size = sizes_of_sets(*points, &merger);
  std::vector<int> number(count, -1);
  points->track.assign(count, -1);
  points->tracks = 0;
  for (int i = 0; i < count; ++i) {
    const int root = merger.root(i);
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
