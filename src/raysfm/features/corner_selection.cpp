#include "raysfm/features/corner_selection.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <functional>

namespace raysfm {
namespace {

// Enough for the cells to even out the density, few enough corners per cell for the best to be good.
constexpr int kCornersPerCell = 4;

// Ordered by score and then the earlier corner, greatest first. Floats that are not negative compare like
// their bits.
uint64_t rank(const Corner& corner, int index) {
  return uint64_t{std::bit_cast<uint32_t>(corner.score)} << 32 | ~static_cast<uint32_t>(index);
}
int index_of(uint64_t rank) {
  return static_cast<int>(~static_cast<uint32_t>(rank));
}

}  // namespace

void CornerSelector::choose_per_cell(const std::vector<Corner>& corners, int width, int height,
                                     int max_corners, const CellShares& shares) {
  const double cells_wanted = std::max(1.0, max_corners / static_cast<double>(kCornersPerCell));
  const int side =
      std::max(1, static_cast<int>(std::ceil(std::sqrt(double{1} * width * height / cells_wanted))));
  const int columns = (width + side - 1) / side;
  const int cells = columns * ((height + side - 1) / side);
  const int quota = static_cast<int>(shares.least * max_corners) / cells;
  const bool is_limited = std::isfinite(shares.most);
  if (quota == 0 && !is_limited) return;

  const auto cell_of = [&](const Corner& c) {
    return static_cast<int>(c.y) / side * columns + static_cast<int>(c.x) / side;
  };
  starts_.assign(cells + 2, 0);
  for (const Corner& c : corners) ++starts_[cell_of(c) + 2];
  for (int i = 2; i < cells + 2; ++i) starts_[i] += starts_[i - 1];
  ranks_.resize(corners.size());
  for (int i = 0; i < static_cast<int>(corners.size()); ++i) {
    ranks_[starts_[cell_of(corners[i]) + 1]++] = rank(corners[i], i);
  }
  const size_t most = is_limited ? most_of_cell(cells, max_corners, shares.most) : corners.size();
  for (int cell = 0; cell < cells; ++cell) {
    const std::span of_cell(ranks_.begin() + starts_[cell], ranks_.begin() + starts_[cell + 1]);
    if (of_cell.size() > most) {
      const auto last = of_cell.begin() + static_cast<std::ptrdiff_t>(most);
      std::nth_element(of_cell.begin(), last, of_cell.end(), std::greater<>());
      for (auto i = last; i != of_cell.end(); ++i) crowded_[index_of(*i)] = 1;
    }
    choose_best(of_cell, quota);
  }
}

// So many that all cells together have enough.
size_t CornerSelector::most_of_cell(int cells, int max_corners, float shares) const {
  auto most =
      static_cast<int>(std::ceil(shares * static_cast<float>(max_corners) / static_cast<float>(cells)));
  const auto together = [&] {
    int count = 0;
    for (int cell = 0; cell < cells; ++cell) count += std::min(most, starts_[cell + 1] - starts_[cell]);
    return count;
  };
  while (together() < max_corners) ++most;
  return most;
}

// Chooses those of the best that are in a better class than the last of them, classes being scores within an
// eighth of a power of two, and returns those that are in its class. Few are left to be compared, and no
// branch depends on a single score.
std::span<uint64_t> CornerSelector::choose_better_classes(std::span<uint64_t> ranks, size_t* count) {
  constexpr int kClassShift = 52;  // exponent and three bits of the fraction
  std::array<uint32_t, size_t{1} << (64 - kClassShift)> members{};
  for (const uint64_t r : ranks) ++members[r >> kClassShift];
  size_t last = members.size() - 1, better = 0, left = 0;
  while (better + members[last] < *count) better += members[last--];
  for (const uint64_t r : ranks) {
    chosen_[index_of(r)] |= static_cast<uint8_t>(r >> kClassShift > last);
    ranks[left] = r;
    left += r >> kClassShift == last;
  }
  *count -= better;
  return ranks.first(left);
}

void CornerSelector::choose_best(std::span<uint64_t> ranks, size_t count) {
  constexpr size_t kMany = 256;
  count = std::min(count, ranks.size());
  if (ranks.size() > kMany) ranks = choose_better_classes(ranks, &count);
  const auto last = ranks.begin() + static_cast<std::ptrdiff_t>(count);
  if (last != ranks.end()) std::nth_element(ranks.begin(), last, ranks.end(), std::greater<>());
  for (auto i = ranks.begin(); i != last; ++i) chosen_[index_of(*i)] = 1;
}

void CornerSelector::select(int width, int height, int max_corners, const CellShares& shares,
                            std::vector<Corner>* corners) {
  const int count = static_cast<int>(corners->size());
  if (count <= max_corners) return;
  chosen_.assign(count, 0);
  crowded_.assign(count, 0);
  choose_per_cell(*corners, width, height, max_corners, shares);

  ranks_.clear();
  int chosen = 0;
  for (int i = 0; i < count; ++i) {
    chosen += chosen_[i];
    if (chosen_[i] == 0 && crowded_[i] == 0) ranks_.push_back(rank((*corners)[i], i));
  }
  choose_best(ranks_, max_corners - chosen);

  int kept = 0;
  for (int i = 0; i < count; ++i) {
    if (chosen_[i]) (*corners)[kept++] = (*corners)[i];
  }
  corners->resize(kept);
}

}  // namespace raysfm
