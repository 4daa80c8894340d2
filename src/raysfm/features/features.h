#pragma once

#include <Eigen/Core>
#include <vector>

namespace raysfm {

// Interest points of one image, element i of both vectors belonging together.
struct Features {
  std::vector<Eigen::Vector2f> pixels;  // (u, v), sub-pixel, in scan order: by row, then by column
  std::vector<float> scores;            // detector response, > 0, the larger the better

  int size() const { return static_cast<int>(pixels.size()); }
  void clear() {
    pixels.clear();
    scores.clear();
  }
};

}  // namespace raysfm
