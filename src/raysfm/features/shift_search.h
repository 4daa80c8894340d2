#pragma once

#include <Eigen/Core>

#include "raysfm/image/image.h"

namespace raysfm {

struct ShiftSearchResult {
  Eigen::Vector2i shift = Eigen::Vector2i::Zero();  // second(p + shift) looks like first(p)
  float zncc = 0;                                   // over the overlap
};

// Tries every whole-pixel shift of up to a quarter of the width and height and returns the one with the
// highest zero-mean normalised cross-correlation over the overlap (of equal ones the first, by rows). Both
// images have the same size, at most kMaxShiftSearchSide wide and high; larger or empty ones give zncc = 0.
constexpr int kMaxShiftSearchSide = 48;
ShiftSearchResult search_shift(const GrayView& first, const GrayView& second);

}  // namespace raysfm
