#include "raysfm/image/noise.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <numbers>
#include <vector>

#include "raysfm/image/blur.h"

namespace raysfm {
namespace {

constexpr int kBlocksAcross = 8, kBlocksDown = 6, kBlockSide = 16;  // blocks, and their pixels
constexpr double kLower = 0.2, kUpper = 0.8;                        // quantiles
// Grey levels of noise that an encoder and the rounding to whole levels have made coarse, so that second
// differences do not see them.
constexpr double kUnseen = 2;
// All noise as a part of the contrast: where blurring begins, and where it has reached a pixel.
constexpr double kNoisy = 0.25, kVeryNoisy = 0.35;
// Grey levels. Corners and patches of less contrast are not looked at.
constexpr double kLeastContrast = 5, kMostGain = 4;

struct Block {
  double noise = 0, deviation = 0, mean = 0;  // grey levels
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
          std::sqrt(std::max(0.0, squares / kPixels - mean * mean)), mean};
}

double quantile(std::vector<double>* values, double share) {
  const auto at = values->begin() + static_cast<ptrdiff_t>(share * static_cast<double>(values->size()));
  std::ranges::nth_element(*values, at);
  return *at;
}

// The side of blur3(), which is to run twice.
int blur_for(const Grain& grain) {
  const double share = (grain.noise + kUnseen) / grain.contrast;
  const double part = std::clamp((share - kNoisy) / (kVeryNoisy - kNoisy), 0.0, 1.0);
  return static_cast<int>(std::lround(kBinomial * part));
}

// Levels keep their order; the mean goes towards the middle, so that neither end is cut off.
void stretch(double gain, double mean, GrayImage* image) {
  constexpr double kMiddle = 127.5;
  std::array<uint8_t, 256> levels;
  for (int v = 0; v < 256; ++v) {
    const double level = kMiddle + (mean - kMiddle) / gain + gain * (v - mean);
    levels[v] = static_cast<uint8_t>(std::clamp(level + 0.5, 0.0, 255.0));
  }
  for (int y = 0; y < image->height(); ++y) {
    uint8_t* row = image->row(y);
    for (int x = 0; x < image->width(); ++x) row[x] = levels[row[x]];
  }
}

}  // namespace

Grain grain_of(const GrayView& image) {
  if (image.width < kBlockSide + 2 || image.height < kBlockSide + 2) return {};
  std::vector<double> noise, deviation;
  double sum = 0;
  for (int j = 0; j < kBlocksDown; ++j) {
    const int top = 1 + (image.height - kBlockSide - 2) * (2 * j + 1) / (2 * kBlocksDown);
    for (int i = 0; i < kBlocksAcross; ++i) {
      const Block block =
          look_at(image, 1 + (image.width - kBlockSide - 2) * (2 * i + 1) / (2 * kBlocksAcross), top);
      if (block.noise == 0) continue;  // no picture: a border, or too bright
      noise.push_back(block.noise);
      deviation.push_back(block.deviation);
      sum += block.mean;
    }
  }
  if (2 * std::ssize(noise) < kBlocksAcross * kBlocksDown) return {};
  return {quantile(&noise, kLower), quantile(&deviation, kUpper), sum / static_cast<double>(noise.size())};
}

void subdue_noise(GrayImage* image) {
  const Grain grain = grain_of(image->view());
  if (grain.contrast == 0) return;
  const double gain = std::clamp(kLeastContrast / grain.contrast, 1.0, kMostGain);
  if (gain > 1) stretch(gain, grain.mean, image);
  const int side = blur_for(grain);
  if (side == 0) return;
  GrayImage once;
  blur3(image->view(), side, &once);
  blur3(once.view(), side, image);
}

}  // namespace raysfm
