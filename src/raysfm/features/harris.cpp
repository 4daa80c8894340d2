#include "raysfm/features/harris.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "raysfm/features/corner_selection.h"
#include "raysfm/features/harris_rows.h"
#include "raysfm/features/octaves.h"

namespace raysfm {
namespace {

constexpr int kMinBorder = 5;  // gradient 1, window 2, neighbourhood of a maximum 2
constexpr int kMaskReach = 6;  // pixels; what lies this close to the edge of the mask is an artefact of it
constexpr int kWindow = 5;     // rows of products that one row of response needs
constexpr int kMaxima = 5;     // rows of response that one row of maxima needs
constexpr int kAtOnce = 2;     // rows that a stage makes at a time

// The image is worked on strip by strip, so that the rows that a stage looks at stay in the nearest cache.
constexpr int kStripWidth = 256;  // the fastest of 128, 256 and 640
constexpr int kStripMargin = 8;   // at least what a corner depends on to either side: kMinBorder

static_assert(kStripWidth + 2 * kStripMargin <= kMaxRowWidth);

// Columns [begin, end) of an image, and [left, right) about them that are looked at.
struct Strip {
  int begin, end;
  int left, right;
};

// Rows that are reused in turn, their first columns aligned to 64 bytes.
template <typename T, int kRows>
class RowRing {
 public:
  void reset(int width) {
    data_.resize(width + 2 * kRowMargin, kRows);
    for (int y = 0; y < kRows; ++y) std::fill_n(data_.row(y), data_.width(), T{0});
  }
  T* row(int y) { return data_.row(static_cast<int>(static_cast<unsigned>(y) % kRows)) + kRowMargin; }

 private:
  Image<T> data_;
};

// Abscissa of the maximum of the parabola through (-1, a), (0, b), (1, c), where b is not below a and c.
float parabola_peak(float a, float b, float c) {
  const float curvature = a - 2 * b + c;
  return curvature < 0 ? std::clamp(0.5f * (a - c) / curvature, -0.5f, 0.5f) : 0.0f;
}

bool sees_the_scene(const GrayView& mask, int octave, int x, int y) {
  for (int dy = -kMaskReach; dy <= kMaskReach; dy += kMaskReach) {
    for (int dx = -kMaskReach; dx <= kMaskReach; dx += kMaskReach) {
      const int u = std::clamp((x + dx) << octave, 0, mask.width - 1);
      const int v = std::clamp((y + dy) << octave, 0, mask.height - 1);
      if (mask(u, v) != 255) return false;
    }
  }
  return true;
}

}  // namespace

struct HarrisDetector::Scratch {
  RowRing<int16_t, 1> gradient_x, gradient_y;                // of the current row
  RowRing<float, kWindow + kAtOnce - 1> smooth;              // smooth_products() of these
  RowRing<float, kMaxima + kAtOnce - 1> response, greatest;  // and its max_along_row()
  std::vector<int> columns;
  std::vector<Corner> found, corners;
  std::vector<int> rows, row_begin;  // of `found`; of `corners`, by row
  CornerSelector selector;

  void reset(int width) {
    for (auto* ring : {&gradient_x, &gradient_y}) ring->reset(width);
    smooth.reset(3 * kPartOfRow);
    for (auto* ring : {&response, &greatest}) ring->reset(width);
    columns.resize(width);
  }

  // Each stage follows the one before by as many rows as it looks down, so that all of its input is in cache.
  void detect(const GrayView& image, const HarrisOptions& options, int border, const Strip& strip) {
    const GrayView part = {image.data + strip.left, strip.right - strip.left, image.height, image.stride};
    for (int y = 1; y < image.height - 1; y += kAtOnce) {
      add_products(part, y);
      add_products(part, y + 1);
      const int response_row = y - kWindow / 2;
      if (response_row < kWindow / 2) continue;
      add_responses(part.width, options.k, response_row);
      for (int corner_row = response_row - kMaxima / 2; corner_row < response_row; ++corner_row) {
        if (corner_row >= border && corner_row < image.height - border)
          add_corners(options, strip, corner_row);
      }
    }
  }

  // The row below the last one has none, and nothing that counts looks at it.
  void add_products(const GrayView& image, int y) {
    if (y == image.height - 1) return;
    gradients(image.row(y - 1), image.row(y), image.row(y + 1), image.width, gradient_x.row(0),
              gradient_y.row(0));
    smooth_products(gradient_x.row(0), gradient_y.row(0), image.width, smooth.row(y));
  }

  // Of row y and the one below.
  void add_responses(int width, float k, int y) {
    std::array<const float*, kWindow + kAtOnce - 1> rows;
    for (int i = 0; i < static_cast<int>(rows.size()); ++i) rows[i] = smooth.row(y - kWindow / 2 + i);
    harris_responses(rows.data(), width, k, response.row(y), response.row(y + 1));
    max_along_row(response.row(y), width, greatest.row(y));
    max_along_row(response.row(y + 1), width, greatest.row(y + 1));
  }

  void add_corners(const HarrisOptions& options, const Strip& strip, int y) {
    std::array<const float*, kMaxima> around;
    for (int i = 0; i < kMaxima; ++i) around[i] = greatest.row(y - kMaxima / 2 + i);
    const float *above = response.row(y - 1), *row = response.row(y), *below = response.row(y + 1);
    const int count = find_maxima(row, around.data(), strip.begin - strip.left, strip.end - strip.left,
                                  options.min_score, columns.data());
    for (int i = 0; i < count; ++i) {
      const int column = columns[i], x = strip.left + column;
      if (!options.mask.empty() && !sees_the_scene(options.mask, options.octave, x, y)) continue;
      const float dx = parabola_peak(row[column - 1], row[column], row[column + 1]);
      const float dy = parabola_peak(above[column], row[column], below[column]);
      found.push_back({static_cast<float>(x) + dx, static_cast<float>(y) + dy, row[column]});
      rows.push_back(y);
    }
  }

  // From strip by strip to scan order.
  void sort_corners(int height) {
    row_begin.assign(height + 1, 0);
    for (const int y : rows) ++row_begin[y + 1];
    for (int y = 0; y < height; ++y) row_begin[y + 1] += row_begin[y];
    corners.resize(found.size());
    for (size_t i = 0; i < found.size(); ++i) corners[row_begin[rows[i]]++] = found[i];
  }
};

HarrisDetector::HarrisDetector() : scratch_(std::make_unique<Scratch>()) {}
HarrisDetector::~HarrisDetector() = default;
HarrisDetector::HarrisDetector(HarrisDetector&&) noexcept = default;
HarrisDetector& HarrisDetector::operator=(HarrisDetector&&) noexcept = default;

void HarrisDetector::detect(const GrayView& image, const HarrisOptions& options, Features* features) {
  features->clear();
  const int border = std::max(options.border, kMinBorder);
  if (image.width <= 2 * border || image.height <= 2 * border || options.max_features <= 0) return;

  Scratch& s = *scratch_;
  s.found.clear(), s.rows.clear();
  s.reset(std::min(image.width, kStripWidth + 2 * kStripMargin));
  for (int begin = border; begin < image.width - border; begin += kStripWidth) {
    const int end = std::min(begin + kStripWidth, image.width - border);
    s.detect(image, options, border,
             {begin, end, std::max(0, begin - kStripMargin), std::min(image.width, end + kStripMargin)});
  }
  s.sort_corners(image.height);
  s.selector.select(image.width, image.height, options.max_features, options.shares, &s.corners);
  for (const Corner& c : s.corners) {
    features->pixels.push_back(out_of_octave({c.x, c.y}, options.octave));
    features->scores.push_back(c.score);
    features->octaves.push_back(static_cast<uint8_t>(options.octave));
  }
}

}  // namespace raysfm
