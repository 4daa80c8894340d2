#include "raysfm/boards/view_choice.h"

#include <algorithm>
#include <limits>

namespace raysfm {
namespace {

// How far apart the farthest corners of the board are.
double size_in_image(const BoardView& view) {
  double size = 0;
  for (const BoardImage& image : view) {
    if (image.pixels.empty()) continue;
    size = std::max(size, (image.pixels.front() - image.pixels.back()).norm());
  }
  return size;
}

double view_distance(const BoardView& a, const BoardView& b) {
  double distance = -1;
  for (const BoardImage& image : a) {
    const BoardImage* other = image_of(b, image.camera);
    if (other) distance = std::max(distance, mean_distance(image.pixels, other->pixels));
  }
  return distance < 0 ? std::numeric_limits<double>::infinity() : distance;
}

}  // namespace

std::vector<int> differing_views(std::span<const BoardView> views, double least_distance, int most) {
  std::vector<int> chosen;
  std::vector<double> distance(views.size(), std::numeric_limits<double>::infinity());
  if (views.empty()) return chosen;
  size_t next = 0;
  for (size_t i = 1; i < views.size(); ++i) {
    if (size_in_image(views[i]) > size_in_image(views[next])) next = i;
  }
  while (static_cast<int>(chosen.size()) < most && distance[next] > least_distance) {
    chosen.push_back(static_cast<int>(next));
    for (size_t i = 0; i < views.size(); ++i) {
      distance[i] = i == next ? 0 : std::min(distance[i], view_distance(views[i], views[next]));
    }
    next = std::max_element(distance.begin(), distance.end()) - distance.begin();
  }
  std::sort(chosen.begin(), chosen.end());
  return chosen;
}

}  // namespace raysfm
