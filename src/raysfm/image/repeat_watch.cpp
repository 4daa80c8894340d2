#include "raysfm/image/repeat_watch.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>

namespace raysfm {
namespace {

// Rows that are compared, of a picture however large.
constexpr int kRows = 128;
// At most this part of the pixels of a copy was changed by an encoder, and at most that part of those that
// changed when the picture did last; in a copy without any rhythm at most the last.
constexpr double kMostChanged = 0.3, kChangedShare = 0.4, kHardlyChanged = 0.05;
// So many copies, with all that came between, make a rhythm; frames.
constexpr int kRuns = 3, kWithin = 60;
// Pixels by which an encoder seems to move a copy, and one that hardly changed. A camera moves farther.
constexpr double kMostMoved = 0.12, kHardlyMoved = 0.02;
constexpr int kAcross = 8, kDown = 6;  // cells whose motion is asked for
// Squared grey levels per pixel that the gradients of a cell must have along every direction.
constexpr double kTexture = 4;

int row_step(int height) {
  return std::max(1, height / kRows);
}

// Sums over the pixels of a cell: of products of its gradient, and of these with what has changed.
struct Cell {
  int64_t xx = 0, xy = 0, yy = 0, xd = 0, yd = 0, count = 0;

  void add(int gx, int gy, int changed) {
    xx += gx * gx, xy += gx * gy, yy += gy * gy;
    xd += gx * changed, yd += gy * changed;
    ++count;
  }
};

// By how much the content of a cell has moved, to first order; pixels. `gradients` are twice those of the
// picture. Below 0 where there is too little texture to tell.
double motion_of(const Cell& cell) {
  const double xx = 0.25 * double(cell.xx), xy = 0.25 * double(cell.xy), yy = 0.25 * double(cell.yy);
  const double xd = 0.5 * double(cell.xd), yd = 0.5 * double(cell.yd);
  const double least = 0.5 * (xx + yy) - std::hypot(0.5 * (xx - yy), xy);
  if (!(least > kTexture * double(cell.count))) return -1;
  const double det = xx * yy - xy * xy;
  return std::hypot(yy * xd - xy * yd, xx * yd - xy * xd) / det;
}

}  // namespace

// 1 where the picture has another size.
double RepeatWatch::changed_part(const Rows& rows, const GrayView& picture) {
  if (rows.width != picture.width || rows.height != picture.height || rows.pixels.empty()) return 1;
  const uint8_t* before = rows.pixels.data();
  size_t same = 0;
  for (int y = 0; y < picture.height; y += row_step(picture.height), before += picture.width) {
    const uint8_t* now = picture.row(y);
    int same_in_row = 0;
    for (int x = 0; x < picture.width; ++x) same_in_row += before[x] == now[x];
    same += same_in_row;
  }
  return 1 - static_cast<double>(same) / static_cast<double>(rows.pixels.size());
}

// That three quarters of the cells with texture do not exceed; 0 where no cell has any.
double RepeatWatch::motion(const Rows& rows, const GrayView& picture) {
  const int step = row_step(picture.height);
  std::vector<Cell> cells(kAcross * kDown);
  for (int y = 0; y < picture.height; y += step) {
    if (y == 0 || y + 1 >= picture.height) continue;
    const uint8_t* before = rows.pixels.data() + size_t(y / step) * picture.width;
    const uint8_t *now = picture.row(y), *above = picture.row(y - 1), *below = picture.row(y + 1);
    Cell* of_row = cells.data() + kAcross * (y * kDown / picture.height);
    for (int x = 1; x + 1 < picture.width; ++x) {
      of_row[x * kAcross / picture.width].add(now[x + 1] - now[x - 1], below[x] - above[x],
                                              now[x] - before[x]);
    }
  }
  std::vector<double> moved;
  for (const Cell& cell : cells) {
    if (const double m = motion_of(cell); m >= 0) moved.push_back(m);
  }
  if (moved.empty()) return 0;
  const auto quarter = moved.begin() + std::ssize(moved) * 3 / 4;
  std::ranges::nth_element(moved, quarter);
  return *quarter;
}

RepeatWatch::Likeness RepeatWatch::likeness(const Rows& rows, const GrayView& picture, double changed) {
  if (changed > kMostChanged) return Likeness::kNone;
  const double moved = motion(rows, picture);
  if (changed <= kHardlyChanged && moved <= kHardlyMoved) return Likeness::kSame;
  const bool alike = changed <= kChangedShare * rows.changed && moved <= kMostMoved;
  return alike ? Likeness::kAlike : Likeness::kNone;
}

bool RepeatWatch::is_rhythm(int frame) const {
  return runs_.size() == kRuns && frame - runs_.front() <= kWithin;
}

void RepeatWatch::keep(const GrayView& picture, double changed, Rows* rows) {
  const bool is_known = rows->width == picture.width && rows->height == picture.height;
  *rows = {picture.width, picture.height, std::move(rows->pixels), is_known ? changed : -1};
  rows->pixels.clear();
  for (int y = 0; y < picture.height; y += row_step(picture.height)) {
    rows->pixels.insert(rows->pixels.end(), picture.row(y), picture.row(y) + picture.width);
  }
}

int RepeatWatch::original_of(int frame, std::span<const GrayView> pictures) {
  rows_.resize(pictures.size());
  std::vector<double> changed;
  Likeness least = original_ < 0 ? Likeness::kNone : Likeness::kSame;
  for (size_t s = 0; s < pictures.size(); ++s) {
    changed.push_back(changed_part(rows_[s], pictures[s]));
    if (least != Likeness::kNone) least = std::min(least, likeness(rows_[s], pictures[s], changed[s]));
  }
  if (least == Likeness::kNone) {
    if (in_run_) runs_.push_back(frame);
    if (runs_.size() > kRuns) runs_.erase(runs_.begin());
    for (size_t s = 0; s < pictures.size(); ++s) keep(pictures[s], changed[s], &rows_[s]);
  }
  in_run_ = least != Likeness::kNone;
  if (least == Likeness::kSame || (in_run_ && is_rhythm(frame))) {
    ++repeats_;
    return original_;
  }
  original_ = frame;
  return -1;
}

}  // namespace raysfm
