#include "raysfm/views/sight_mask.h"

#include <algorithm>
#include <vector>

#include "raysfm/features/patches.h"

namespace raysfm {
namespace {

// 1 where one of the pixels within the radius is set, along rows (step 1) or columns.
void dilate(const std::vector<uint8_t>& in, int count, int step, int lines, int line_step, int radius,
            std::vector<uint8_t>* out) {
  for (int line = 0; line < lines; ++line) {
    const int base = line * line_step;
    int last = -radius - 1;  // newest set pixel up to i + radius
    for (int i = -radius; i < count; ++i) {
      if (i + radius < count && in[base + (i + radius) * step]) last = i + radius;
      if (i >= 0) (*out)[base + i * step] = last >= i - radius;
    }
  }
}

// Pixels between those that are asked first. A hole of a table is four cells of its grid wide, a mirror does
// not show what hides its camera; and about a border that passes between them the cells next to blind ones
// are asked pixel by pixel.
constexpr int kProbe = 4;

bool is_blind(const Camera& camera, int x, int y) {
  Ray ray;
  return !camera.ray({std::min(x, camera.width - 1), std::min(y, camera.height - 1)}, &ray);
}

// The cells of the grid that all pixels have to be asked of: one of their corners, or of their neighbours',
// is blind. Rows of `columns`.
std::vector<uint8_t> mixed_cells(const Camera& camera, int columns, int rows) {
  std::vector<uint8_t> mixed(static_cast<size_t>(columns) * rows, 0);
  for (int row = 0; row <= rows; ++row) {
    for (int column = 0; column <= columns; ++column) {
      if (!is_blind(camera, column * kProbe, row * kProbe)) continue;
      for (int r = std::max(row - 2, 0); r < std::min(row + 2, rows); ++r) {
        for (int c = std::max(column - 2, 0); c < std::min(column + 2, columns); ++c)
          mixed[static_cast<size_t>(r) * columns + c] = 1;
      }
    }
  }
  return mixed;
}

// 1 for each pixel without a ray; empty where there is none.
std::vector<uint8_t> blind_pixels(const Camera& camera) {
  const int columns = (camera.width + kProbe - 1) / kProbe, rows = (camera.height + kProbe - 1) / kProbe;
  const std::vector<uint8_t> mixed = mixed_cells(camera, columns, rows);
  if (std::ranges::find(mixed, 1) == mixed.end()) return {};
  std::vector<uint8_t> blind(static_cast<size_t>(camera.width) * camera.height, 0);
  for (int y = 0; y < camera.height; ++y) {
    for (int x = 0; x < camera.width; ++x) {
      if (mixed[static_cast<size_t>(y / kProbe) * columns + x / kProbe])
        blind[static_cast<size_t>(y) * camera.width + x] = is_blind(camera, x, y);
    }
  }
  return blind;
}

}  // namespace

GrayImage sight_mask(const Camera& camera, GrayImage mask) {
  const int width = camera.width, height = camera.height;
  std::vector<uint8_t> blind = blind_pixels(camera);
  if (blind.empty()) return mask;
  std::vector<uint8_t> rows(blind.size());
  dilate(blind, width, 1, height, width, kPatchRadius + 1, &rows);
  dilate(rows, height, width, width, 1, kPatchRadius + 1, &blind);
  if (mask.empty()) {
    mask = GrayImage(width, height);
    for (int y = 0; y < height; ++y) std::fill_n(mask.row(y), width, uint8_t{255});
  }
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      if (blind[static_cast<size_t>(y) * width + x]) mask.row(y)[x] = 0;
    }
  }
  return mask;
}

}  // namespace raysfm
