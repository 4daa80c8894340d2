#include "raysfm/features/corner_selection.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace raysfm {
namespace {

// Enough for the cells to even out the density, few enough corners per cell for the best to be good.
constexpr int kCornersPerCell = 4;

}  // namespace

void CornerSelector::choose_per_cell(const std::vector<Corner>& corners, int width, int height,
                                     int max_corners, float spread) {
  const double cells_wanted = std::max(1.0, max_corners / static_cast<double>(kCornersPerCell));
  const int side =
      std::max(1, static_cast<int>(std::ceil(std::sqrt(double{1} * width * height / cells_wanted))));
  const int columns = (width + side - 1) / side;
  const int cells = columns * ((height + side - 1) / side);
  const int quota = static_cast<int>(spread * max_corners) / cells;
  if (quota == 0) return;

  const auto cell_of = [&](const Corner& c) {
    return static_cast<int>(c.y) / side * columns + static_cast<int>(c.x) / side;
  };
  starts_.assign(cells + 2, 0);
  for (const Corner& c : corners) ++starts_[cell_of(c) + 2];
  for (int i = 2; i < cells + 2; ++i) starts_[i] += starts_[i - 1];
  order_.resize(corners.size());
  for (int i = 0; i < static_cast<int>(corners.size()); ++i) order_[starts_[cell_of(corners[i]) + 1]++] = i;

  const auto better = [&](int a, int b) {
    return corners[a].score != corners[b].score ? corners[a].score > corners[b].score : a < b;
  };
  for (int cell = 0; cell < cells; ++cell) {
    const auto begin = order_.begin() + starts_[cell], end = order_.begin() + starts_[cell + 1];
    const auto last = begin + std::min<std::ptrdiff_t>(quota, end - begin);
    if (last != end) std::nth_element(begin, last, end, better);
    for (auto i = begin; i != last; ++i) chosen_[*i] = 1;
  }
}

void CornerSelector::select(int width, int height, int max_corners, float spread,
                            std::vector<Corner>* corners) {
  const int count = static_cast<int>(corners->size());
  if (count <= max_corners) return;
  chosen_.assign(count, 0);
  choose_per_cell(*corners, width, height, max_corners, spread);

  order_.clear();
  for (int i = 0; i < count; ++i) {
    if (!chosen_[i]) order_.push_back(i);
  }
  const int left = max_corners - (count - static_cast<int>(order_.size()));
  const auto better = [&](int a, int b) {
    return (*corners)[a].score != (*corners)[b].score ? (*corners)[a].score > (*corners)[b].score : a < b;
  };
  std::nth_element(order_.begin(), order_.begin() + left, order_.end(), better);
  for (int i = 0; i < left; ++i) chosen_[order_[i]] = 1;

  int kept = 0;
  for (int i = 0; i < count; ++i) {
    if (chosen_[i]) (*corners)[kept++] = (*corners)[i];
  }
  corners->resize(kept);
}

}  // namespace raysfm
