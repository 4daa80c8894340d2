#include "raysfm/uncalibrated/dense_groups.h"

#include <Eigen/Core>
#include <algorithm>
#include <functional>
#include <numeric>

namespace raysfm {
namespace {

constexpr int kEnoughShared = 100;  // points: more do not tie two images together any better

// How well each two images are tied together by the points that both see.
Eigen::MatrixXi ties(const PointTracks& tracks) {
  std::vector<std::vector<int>> images_of(tracks.point_count);
  for (int k = 0; k < tracks.size(); ++k) images_of[tracks.point[k]].push_back(tracks.image[k]);
  Eigen::MatrixXi shared = Eigen::MatrixXi::Zero(tracks.image_count, tracks.image_count);
  for (const std::vector<int>& images : images_of) {
    for (const int a : images) {
      for (const int b : images) shared(a, b) += a != b;
    }
  }
  return shared.cwiseMin(kEnoughShared);
}

// The image that is tied best to so many others, of those that are not taken; -1 without one.
int best_seed(const Eigen::MatrixXi& ties, int others, const std::vector<uint8_t>& taken) {
  int best = -1, most = 0;
  for (int j = 0; j < ties.cols(); ++j) {
    if (taken[j]) continue;
    std::vector<int> of_image(ties.col(j).begin(), ties.col(j).end());
    const auto middle = of_image.begin() + std::min<std::ptrdiff_t>(others, std::ssize(of_image));
    std::partial_sort(of_image.begin(), middle, of_image.end(), std::greater<>());
    const int sum = std::accumulate(of_image.begin(), middle, 0);
    if (sum > most) best = j, most = sum;
  }
  return best;
}

}  // namespace

std::vector<std::vector<int>> dense_groups(const PointTracks& tracks, int size, int count) {
  const Eigen::MatrixXi tie = ties(tracks);
  std::vector<std::vector<int>> groups;
  std::vector<uint8_t> taken(tracks.image_count, 0);
  while (std::ssize(groups) < count) {
    const int seed = best_seed(tie, size, taken);
    if (seed < 0) break;
    std::vector<int> group = {seed};
    Eigen::VectorXi to_group = tie.col(seed);
    std::vector<uint8_t> inside(tracks.image_count, 0);
    inside[seed] = 1;
    while (std::ssize(group) < size) {
      int next = -1;
      for (int j = 0; j < tracks.image_count; ++j) {
        if (!inside[j] && to_group[j] > 0 && (next < 0 || to_group[j] > to_group[next])) next = j;
      }
      if (next < 0) break;
      group.push_back(next);
      inside[next] = 1;
      to_group += tie.col(next);
    }
    for (const int j : group) taken[j] = 1;
    std::ranges::sort(group);
    groups.push_back(std::move(group));
  }
  return groups;
}

}  // namespace raysfm
