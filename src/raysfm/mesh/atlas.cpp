#include "raysfm/mesh/atlas.h"

#include <algorithm>
#include <limits>
#include <numeric>

namespace raysfm {
namespace {

// The lower edge of what is placed, from left to right.
struct Step {
  int x, y;
};

// How low a patch comes to lie that begins at step `first`; -1 where it is too wide there.
int lowest_above(const std::vector<Step>& skyline, size_t first, int patch, int width) {
  if (skyline[first].x + patch > width) return -1;
  int y = 0;
  for (size_t i = first; i < skyline.size() && skyline[i].x < skyline[first].x + patch; ++i)
    y = std::max(y, skyline[i].y);
  return y;
}

void cover(std::vector<Step>* skyline, size_t first, int patch, int y) {
  const int begin = (*skyline)[first].x, end = begin + patch;
  size_t last = first;
  int beyond = y;
  while (last < skyline->size() && (*skyline)[last].x < end) beyond = (*skyline)[last++].y;
  const bool is_part = last == skyline->size() || (*skyline)[last].x > end;
  skyline->erase(skyline->begin() + static_cast<ptrdiff_t>(first),
                 skyline->begin() + static_cast<ptrdiff_t>(last));
  if (is_part) skyline->insert(skyline->begin() + static_cast<ptrdiff_t>(first), {end, beyond});
  skyline->insert(skyline->begin() + static_cast<ptrdiff_t>(first), {begin, y});
}

}  // namespace

int place_patches(int width, std::vector<AtlasPatch>* patches) {
  std::vector<size_t> order(patches->size());
  std::iota(order.begin(), order.end(), size_t{0});
  std::ranges::stable_sort(order, std::greater<>(), [&](size_t i) { return (*patches)[i].height; });
  std::vector<Step> skyline = {{0, 0}};
  int height = 0;
  for (const size_t i : order) {
    AtlasPatch& patch = (*patches)[i];
    size_t best = 0;
    int lowest = std::numeric_limits<int>::max();
    for (size_t s = 0; s < skyline.size(); ++s) {
      const int y = lowest_above(skyline, s, patch.width, width);
      if (y >= 0 && y < lowest) lowest = y, best = s;
    }
    patch.x = skyline[best].x;
    patch.y = lowest;
    cover(&skyline, best, patch.width, patch.y + patch.height);
    height = std::max(height, patch.y + patch.height);
  }
  return height;
}

}  // namespace raysfm
