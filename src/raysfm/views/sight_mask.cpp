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

}  // namespace

GrayImage sight_mask(const Camera& camera, GrayImage mask) {
  const int width = camera.width, height = camera.height;
  std::vector<uint8_t> blind(static_cast<size_t>(width) * height), rows(blind.size());
  bool any = false;
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      Ray ray;
      const bool sees = camera.ray({x, y}, &ray);
      blind[static_cast<size_t>(y) * width + x] = !sees;
      any |= !sees;
    }
  }
  if (!any) return mask;
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
