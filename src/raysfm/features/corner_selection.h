#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

namespace raysfm {

// A local maximum of the detector's response.
struct Corner {
  float x = 0, y = 0;  // pixels, sub-pixel
  float score = 0;     // >= 0
};

// What a cell of a grid over the image may claim of the corners, in even shares: as many as there are corners
// for each cell.
struct CellShares {
  float least = 0.4f;  // whatever its contrast; in [0, 1]
  // >= 1; where so many are not there, no more than others that have as many.
  float most = std::numeric_limits<float>::infinity();
};

// Chooses at most `max_corners`: first the best of every cell of a grid over the image, their least shares,
// then the best of the rest anywhere, no more of a cell than its most. Ties go to the earlier corner.
class CornerSelector {
 public:
  // Keeps the chosen in their order. width, height > 0.
  void select(int width, int height, int max_corners, const CellShares& shares, std::vector<Corner>* corners);

 private:
  void choose_per_cell(const std::vector<Corner>& corners, int width, int height, int max_corners,
                       const CellShares& shares);
  size_t most_of_cell(int cells, int max_corners, float shares) const;

  void choose_best(std::span<uint64_t> ranks, size_t count);
  std::span<uint64_t> choose_better_classes(std::span<uint64_t> ranks, size_t* count);

  std::vector<int> starts_;      // of each cell in ranks_
  std::vector<uint64_t> ranks_;  // of corners, by cell
  std::vector<char> chosen_;     // per corner
  std::vector<char> crowded_;    // per corner: there are enough better ones in its cell
};

}  // namespace raysfm
