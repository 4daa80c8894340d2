#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace raysfm {

// A local maximum of the detector's response.
struct Corner {
  float x = 0, y = 0;  // pixels, sub-pixel
  float score = 0;     // >= 0
};

// Chooses at most `max_corners`: first the best of every cell of a grid over the image, `spread` of them
// altogether, then the best of the rest anywhere. Ties go to the earlier corner.
class CornerSelector {
 public:
  // Keeps the chosen in their order. width, height > 0; 0 <= spread <= 1.
  void select(int width, int height, int max_corners, float spread, std::vector<Corner>* corners);

 private:
  void choose_per_cell(const std::vector<Corner>& corners, int width, int height, int max_corners,
                       float spread);

  void choose_best(std::span<uint64_t> ranks, size_t count);
  std::span<uint64_t> choose_better_classes(std::span<uint64_t> ranks, size_t* count);

  std::vector<int> starts_;      // of each cell in ranks_
  std::vector<uint64_t> ranks_;  // of corners, by cell
  std::vector<char> chosen_;     // per corner
};

}  // namespace raysfm
