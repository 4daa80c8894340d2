#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

namespace raysfm {

// Interest points of one image, element i of all vectors belonging together.
struct Features {
  // (u, v), sub-pixel, by octave, finest first, then in scan order: by row, then by column.
  std::vector<Eigen::Vector2f> pixels;
  std::vector<float> scores;     // detector response, > 0, the larger the better
  std::vector<uint8_t> octaves;  // of the picture, in which the point was found (octaves.h)

  int size() const { return static_cast<int>(pixels.size()); }
  void clear() {
    pixels.clear();
    scores.clear();
    octaves.clear();
  }
};

}  // namespace raysfm
