#include "raysfm/image/noise.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <numbers>
#include <vector>

namespace raysfm {
namespace {

constexpr int kBlocksAcross = 8, kBlocksDown = 6, kBlockSide = 16;  // blocks, and their pixels
constexpr double kLower = 0.2, kUpper = 0.8;                        // quantiles

struct Block {
  double noise = 0, deviation = 0;  // grey levels
};

// Second differences across of three rows, and of these down: standard deviation 6 for white noise of 1.
Block look_at(const GrayView& image, int left, int top) {
  int differences = 0, sum = 0, squares = 0;
  for (int y = top; y < top + kBlockSide; ++y) {
    const uint8_t *above = image.row(y - 1) + left, *row = image.row(y) + left,
                  *below = image.row(y + 1) + left;
    int of_row = 0, sum_of_row = 0, squares_of_row = 0;
    for (int x = 0; x < kBlockSide; ++x) {
      const int corners = above[x - 1] + above[x + 1] + below[x - 1] + below[x + 1];
      const int sides = above[x] + below[x] + row[x - 1] + row[x + 1];
      of_row += std::abs(corners - 2 * sides + 4 * row[x]);
      sum_of_row += row[x];
      squares_of_row += row[x] * row[x];
    }
    differences += of_row, sum += sum_of_row, squares += squares_of_row;
  }
  constexpr double kPixels = kBlockSide * kBlockSide;
  const double mean = sum / kPixels;
  return {std::sqrt(std::numbers::pi / 2) / 6 * differences / kPixels,
          std::sqrt(std::max(0.0, squares / kPixels - mean * mean))};
}

double quantile(std::vector<double>* values, double share) {
  const auto at = values->begin() + static_cast<ptrdiff_t>(share * static_cast<double>(values->size()));
  std::ranges::nth_element(*values, at);
  return *at;
}

}  // namespace

double noise_share(const GrayView& image) {
  if (image.width < kBlockSide + 2 || image.height < kBlockSide + 2) return 0;
  std::vector<double> noise, deviation;
  for (int j = 0; j < kBlocksDown; ++j) {
    const int top = 1 + (image.height - kBlockSide - 2) * (2 * j + 1) / (2 * kBlocksDown);
    for (int i = 0; i < kBlocksAcross; ++i) {
      const Block block =
          look_at(image, 1 + (image.width - kBlockSide - 2) * (2 * i + 1) / (2 * kBlocksAcross), top);
      if (block.noise == 0) continue;  // no picture: a border, or too bright
      noise.push_back(block.noise);
      deviation.push_back(block.deviation);
    }
  }
  if (2 * std::ssize(noise) < kBlocksAcross * kBlocksDown) return 0;
  const double contrast = quantile(&deviation, kUpper);
  return contrast > 0 ? quantile(&noise, kLower) / contrast : 0;
}

}  // namespace raysfm
