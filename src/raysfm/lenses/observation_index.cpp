#include "raysfm/lenses/observation_index.h"

#include <algorithm>

namespace raysfm {
namespace {

// Drops images and points that are seen too little until nothing changes.
void prune(const PointTracks& tracks, int min_points, int min_images, std::vector<uint8_t>* used) {
  std::vector<int> in_image(tracks.image_count), of_point(tracks.point_count);
  for (bool changed = true; changed;) {
    changed = false;
    std::fill(in_image.begin(), in_image.end(), 0);
    std::fill(of_point.begin(), of_point.end(), 0);
    for (int k = 0; k < tracks.size(); ++k) {
      in_image[tracks.image[k]] += (*used)[k];
      of_point[tracks.point[k]] += (*used)[k];
    }
    for (int k = 0; k < tracks.size(); ++k) {
      if (!(*used)[k]) continue;
      if (in_image[tracks.image[k]] >= min_points && of_point[tracks.point[k]] >= min_images) continue;
      (*used)[k] = 0;
      changed = true;
    }
  }
}

// New numbers of the used ones, -1 for the others; lists the used ones.
std::vector<int> renumber(const std::vector<int>& numbers, int count, const std::vector<uint8_t>& used,
                          std::vector<int>* kept) {
  std::vector<int> renumbered(count, -1);
  for (size_t k = 0; k < numbers.size(); ++k) {
    if (used[k]) renumbered[numbers[k]] = 0;
  }
  for (int i = 0; i < count; ++i) {
    if (renumbered[i] < 0) continue;
    renumbered[i] = static_cast<int>(kept->size());
    kept->push_back(i);
  }
  return renumbered;
}

std::vector<int> prefix_sums(const std::vector<int>& of, int count) {
  std::vector<int> begin(count + 1, 0);
  for (const int i : of) ++begin[i + 1];
  for (int i = 0; i < count; ++i) begin[i + 1] += begin[i];
  return begin;
}

}  // namespace

ObservationIndex index_observations(const PointTracks& tracks, std::span<const double> weights,
                                    const UncalibratedScene* scene, int min_points, int min_images) {
  std::vector<uint8_t> used(tracks.size(), 1);
  for (int k = 0; k < tracks.size(); ++k) {
    const bool weighted = weights.empty() || weights[k] > 0;
    const bool in_front =
        scene == nullptr || (scene->cam_from_world[tracks.image[k]] * scene->points[tracks.point[k]]).z() > 0;
    used[k] = weighted && in_front;
  }
  prune(tracks, min_points, min_images, &used);

  ObservationIndex index;
  const std::vector<int> image = renumber(tracks.image, tracks.image_count, used, &index.images);
  const std::vector<int> point = renumber(tracks.point, tracks.point_count, used, &index.points);
  for (int k = 0; k < tracks.size(); ++k) {
    if (used[k]) index.original.push_back(k);
  }
  std::sort(index.original.begin(), index.original.end(), [&](int a, int b) {
    return std::pair(tracks.image[a], tracks.point[a]) < std::pair(tracks.image[b], tracks.point[b]);
  });
  std::vector<int> image_of;
  for (const int k : index.original) {
    image_of.push_back(image[tracks.image[k]]);
    index.point_of.push_back(point[tracks.point[k]]);
    index.pixel.push_back(tracks.pixel[k]);
    index.weight.push_back(weights.empty() ? 1.0 : weights[k]);
  }
  index.image_begin = prefix_sums(image_of, index.image_count());
  index.point_begin = prefix_sums(index.point_of, index.point_count());
  // Visited by image, so that the images of a point come in order.
  std::vector<int> next(index.point_begin.begin(), index.point_begin.end());
  index.image_of_slot.resize(index.size());
  for (int o = 0; o < index.size(); ++o) {
    index.slot_of.push_back(next[index.point_of[o]]++);
    index.image_of_slot[index.slot_of[o]] = image_of[o];
  }
  return index;
}

}  // namespace raysfm
