#include "raysfm/ray_lenses/threes_in_sight.h"

#include <algorithm>
#include <functional>
#include <numeric>
#include <set>
#include <utility>

namespace raysfm {
namespace {

constexpr int kCentres = 16;     // images that see the most points
constexpr int kNeighbours = 6;   // of each, with which it shares most
constexpr int kLeastInAll = 40;  // points that three images see

// By image, its points ascending.
std::vector<std::vector<int>> points_of_images(const PointTracks& tracks,
                                               const std::vector<std::vector<int>>& of_image) {
  std::vector<std::vector<int>> points(of_image.size());
  for (size_t j = 0; j < of_image.size(); ++j) {
    for (const int k : of_image[j]) points[j].push_back(tracks.point[k]);
    std::ranges::sort(points[j]);
  }
  return points;
}

std::vector<int> common(const std::vector<int>& a, const std::vector<int>& b) {
  std::vector<int> both;
  std::ranges::set_intersection(a, b, std::back_inserter(both));
  return both;
}

// (points in common, image), most first.
std::vector<std::pair<int, int>> neighbours_of(int image, const std::vector<std::vector<int>>& points) {
  std::vector<std::pair<int, int>> shared;
  for (int j = 0; j < static_cast<int>(points.size()); ++j) {
    if (j == image) continue;
    const int count = static_cast<int>(common(points[image], points[j]).size());
    if (count >= kLeastInAll) shared.emplace_back(count, j);
  }
  std::ranges::sort(shared, std::greater<>());
  if (shared.size() > kNeighbours) shared.resize(kNeighbours);
  return shared;
}

}  // namespace

std::vector<std::array<int, 3>> threes_in_sight(const PointTracks& tracks,
                                                const std::vector<std::vector<int>>& of_image) {
  const std::vector<std::vector<int>> points = points_of_images(tracks, of_image);
  std::vector<int> centres(points.size());
  std::iota(centres.begin(), centres.end(), 0);
  std::ranges::stable_sort(centres, std::greater<>(), [&](int j) { return points[j].size(); });
  if (centres.size() > kCentres) centres.resize(kCentres);
  std::set<std::array<int, 3>> found;
  for (const int a : centres) {
    const auto neighbours = neighbours_of(a, points);
    for (size_t i = 0; i < neighbours.size(); ++i) {
      for (size_t l = 0; l < i; ++l) {
        const int b = neighbours[l].second, c = neighbours[i].second;
        if (static_cast<int>(common(common(points[a], points[b]), points[c]).size()) < kLeastInAll) continue;
        // By what the other two share: the one across from the least is between them.
        std::array<std::pair<int, int>, 3> across = {
            {{static_cast<int>(common(points[b], points[c]).size()), a},
             {neighbours[i].first, b},
             {neighbours[l].first, c}}};
        std::ranges::sort(across);
        const auto [first, last] = std::minmax(across[1].second, across[2].second);
        found.insert({first, across[0].second, last});
      }
    }
  }
  return {found.begin(), found.end()};
}

}  // namespace raysfm
