#pragma once

namespace raysfm {

// Uniform cubic B-spline: weights of the four control points around the fraction t in [0, 1] of a cell, and
// their derivatives by t.
struct CubicWeights {
  double value[4];
  double slope[4];

  explicit CubicWeights(double t) {
    const double s = 1 - t;
    value[0] = s * s * s / 6;
    value[1] = 2.0 / 3 - t * t * (1 - 0.5 * t);
    value[2] = 2.0 / 3 - s * s * (1 - 0.5 * s);
    value[3] = t * t * t / 6;
    slope[0] = -0.5 * s * s;
    slope[1] = -t * (2 - 1.5 * t);
    slope[2] = s * (2 - 1.5 * s);
    slope[3] = 0.5 * t * t;
  }
};

}  // namespace raysfm
