#include "raysfm/image/canvas.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <utility>
#include <vector>

#include "raysfm/image/pyramid.h"

namespace raysfm {
namespace {

constexpr int kWeightBits = 8;
constexpr int kOne = 1 << kWeightBits;

// Where a row or column of the canvas is between two of the image.
struct Between {
  int before = 0, after = 0;
  int weight = 0;  // of `after`, of kOne
};

std::vector<Between> places(const CanvasPlace& place, int image_side, int canvas_side) {
  std::vector<Between> all(canvas_side);
  for (int i = 0; i < canvas_side; ++i) {
    const double at = std::clamp(place.back(i, image_side, canvas_side), 0.0, image_side - 1.0);
    const int before = static_cast<int>(at);
    all[i] = {before, std::min(before + 1, image_side - 1),
              static_cast<int>(std::lround((at - before) * kOne))};
  }
  return all;
}

// A row of the canvas between two of the image, as long as these; times kOne.
void mix_rows(const GrayView& image, const Between& y, std::vector<int>* mixed) {
  const uint8_t *above = image.row(y.before), *below = image.row(y.after);
  for (int x = 0; x < image.width; ++x) (*mixed)[x] = (kOne - y.weight) * above[x] + y.weight * below[x];
}

}  // namespace

GrayImage on_canvas(const GrayView& image, const CanvasPlace& place) {
  constexpr int kLeastSide = 4;
  if (place.scale < 0.5 && std::min(image.width, image.height) >= kLeastSide) {
    // Blocks begin at the first row and column: where a last one is left out, the middle is elsewhere by less
    // than a pixel of the image.
    GrayImage half;
    half_sample(image, &half);
    return on_canvas(half.view(), {2 * place.scale, place.width, place.height});
  }
  GrayImage canvas(place.width, place.height);
  const std::vector<Between> columns = places(place, image.width, place.width);
  const std::vector<Between> rows = places(place, image.height, place.height);
  std::vector<int> mixed(image.width);
  for (int y = 0; y < place.height; ++y) {
    uint8_t* out = canvas.row(y);
    const bool same = y > 0 && rows[y].before == rows[y - 1].before && rows[y].weight == rows[y - 1].weight;
    if (same) {
      std::memcpy(out, canvas.row(y - 1), place.width);
      continue;
    }
    mix_rows(image, rows[y], &mixed);
    for (int x = 0; x < place.width; ++x) {
      const Between& c = columns[x];
      const int level = (kOne - c.weight) * mixed[c.before] + c.weight * mixed[c.after];
      out[x] = static_cast<uint8_t>((level + kOne * kOne / 2) >> (2 * kWeightBits));
    }
  }
  return canvas;
}

ColorPlanes on_canvas(const ColorPlanes& colors, const GrayView& gray, const CanvasPlace& place) {
  constexpr int kStep = 4;
  ColorPlanes placed;
  if (colors.empty() || gray.empty()) return placed;
  placed.step_x = placed.step_y = kStep;
  placed.cb.resize((place.width + kStep - 1) / kStep, (place.height + kStep - 1) / kStep);
  placed.cr.resize(placed.cb.width(), placed.cb.height());
  const auto nearest = [&](int pixel, int image_side, int canvas_side) {
    const long at = std::lround(place.back(pixel, image_side, canvas_side));
    return static_cast<int>(std::clamp(at, 0l, static_cast<long>(image_side - 1)));
  };
  const auto chroma = [](int level, int grey, float share) {
    return rounded_level(128 + static_cast<float>(level - grey) / share);
  };
  std::vector<int> columns(placed.cb.width());
  for (int i = 0; i < placed.cb.width(); ++i)
    columns[i] = nearest(kStep * i + kStep / 2, gray.width, place.width);
  for (int j = 0; j < placed.cb.height(); ++j) {
    const int y = nearest(kStep * j + kStep / 2, gray.height, place.height);
    for (int i = 0; i < placed.cb.width(); ++i) {
      const int x = columns[i];
      const uint8_t grey = gray(x, y);
      const std::array<uint8_t, 3> rgb = colors.at(x, y, grey);
      placed.cb.row(j)[i] = chroma(rgb[2], grey, placed.mix.blue_cb);
      placed.cr.row(j)[i] = chroma(rgb[0], grey, placed.mix.red_cr);
    }
  }
  return placed;
}

}  // namespace raysfm
