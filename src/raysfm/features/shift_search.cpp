#include "raysfm/features/shift_search.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "raysfm/features/shift_search.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#ifndef RAYSFM_FEATURES_SHIFT_SEARCH_ONCE
#define RAYSFM_FEATURES_SHIFT_SEARCH_ONCE
namespace raysfm::shift_search {

constexpr int kSide = kMaxShiftSearchSide;
constexpr int kMargin = kSide / 4;
constexpr int kWide = kSide + 2 * kMargin;

// Grey levels less the mean of the image; zero outside of it, so that sums may run over fixed lengths.
struct Centred {
  alignas(64) std::array<std::array<int16_t, kWide>, kSide> rows;  // of kMargin zeros on both sides
  // Sums over the rectangle above and to the left of a pixel.
  std::array<std::array<int32_t, kSide + 1>, kSide + 1> sum, square;
};

}  // namespace raysfm::shift_search
#endif

HWY_BEFORE_NAMESPACE();
namespace raysfm {
namespace HWY_NAMESPACE {

// Sum of first(x, y) * second(x + dx, y + dy) over `rows` rows from y = first_row on. A plain loop of fixed
// length in integers, which compilers turn into vectors of the instruction set.
int32_t correlate_shifted(const shift_search::Centred& first, const shift_search::Centred& second, int dx,
                          int dy, int first_row, int rows) {
  int32_t sum = 0;
  for (int y = first_row; y < first_row + rows; ++y) {
    const int16_t* a = first.rows[y].data() + shift_search::kMargin;
    const int16_t* b = second.rows[y + dy].data() + shift_search::kMargin + dx;
    for (int x = 0; x < shift_search::kSide; ++x) sum += a[x] * b[x];
  }
  return sum;
}

}  // namespace HWY_NAMESPACE
}  // namespace raysfm
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace raysfm {

HWY_EXPORT(correlate_shifted);

namespace {
using namespace shift_search;

void centre(const GrayView& image, Centred* out) {
  int64_t total = 0;
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) total += image(x, y);
  }
  const auto mean = static_cast<int>(total / (image.width * image.height));
  for (auto& row : out->rows) row.fill(0);
  out->sum[0].fill(0);
  out->square[0].fill(0);
  for (int y = 0; y < image.height; ++y) {
    int32_t sum = 0, square = 0;
    out->sum[y + 1][0] = out->square[y + 1][0] = 0;
    for (int x = 0; x < image.width; ++x) {
      const int v = image(x, y) - mean;
      out->rows[y][kMargin + x] = static_cast<int16_t>(v);
      sum += v;
      square += v * v;
      out->sum[y + 1][x + 1] = out->sum[y][x + 1] + sum;
      out->square[y + 1][x + 1] = out->square[y][x + 1] + square;
    }
  }
}

struct Rectangle {
  int x, y, width, height;
};

double rectangle_sum(const std::array<std::array<int32_t, kSide + 1>, kSide + 1>& integral,
                     const Rectangle& r) {
  return integral[r.y + r.height][r.x + r.width] - integral[r.y][r.x + r.width] -
         integral[r.y + r.height][r.x] + integral[r.y][r.x];
}

}  // namespace

ShiftSearchResult search_shift(const GrayView& first, const GrayView& second) {
  ShiftSearchResult best;
  const int w = first.width, h = first.height;
  if (w > kSide || h > kSide || first.empty() || w != second.width || h != second.height) return best;
  Centred a, b;
  centre(first, &a);
  centre(second, &b);
  for (int dy = -h / 4; dy <= h / 4; ++dy) {
    for (int dx = -w / 4; dx <= w / 4; ++dx) {
      const Rectangle in_a{std::max(0, -dx), std::max(0, -dy), w - std::abs(dx), h - std::abs(dy)};
      const Rectangle in_b{std::max(0, dx), std::max(0, dy), in_a.width, in_a.height};
      const double n = in_a.width * in_a.height;
      const double sum_a = rectangle_sum(a.sum, in_a), sum_b = rectangle_sum(b.sum, in_b);
      const double variance_a = rectangle_sum(a.square, in_a) - sum_a * sum_a / n;
      const double variance_b = rectangle_sum(b.square, in_b) - sum_b * sum_b / n;
      if (!(variance_a >= n && variance_b >= n)) continue;  // less than one grey level of texture
      const double product = HWY_DYNAMIC_DISPATCH(correlate_shifted)(a, b, dx, dy, in_a.y, in_a.height);
      const auto zncc =
          static_cast<float>((product - sum_a * sum_b / n) / std::sqrt(variance_a * variance_b));
      if (zncc > best.zncc) best = {{dx, dy}, zncc};
    }
  }
  return best;
}

}  // namespace raysfm
#endif  // HWY_ONCE
