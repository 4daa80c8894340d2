#pragma once

#include <cmath>
#include <span>

namespace raysfm {

// Of all `values`, one or more, about their mean.
inline double standard_deviation(std::span<const double> values) {
  const double share = 1 / static_cast<double>(values.size());
  double mean = 0, square = 0;
  for (const double v : values) mean += share * v;
  for (const double v : values) square += share * (v - mean) * (v - mean);
  return std::sqrt(square);
}

}  // namespace raysfm
