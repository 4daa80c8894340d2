#include "raysfm/lenses/triangular_factor.h"

#include <cmath>

namespace raysfm {

bool Moments::factor(TriangularFactor* t) const {
  constexpr double kFlat = 1e-20;
  if (!(weight > 0)) return false;
  const double mean_x = x / weight, mean_y = y / weight;
  const double s11 = xx / weight, s12 = xy / weight, s22 = yy / weight;
  const double d2 = s22 - mean_y * mean_y;
  if (!(d2 > kFlat * s22)) return false;
  const double d = std::sqrt(d2);
  const double b = (s12 - mean_x * mean_y) / d;
  const double a2 = s11 - mean_x * mean_x - b * b;
  if (!(a2 > kFlat * s11) || !std::isfinite(a2)) return false;
  *t = {std::sqrt(a2), b, mean_x, d, mean_y};
  return true;
}

Eigen::Matrix<double, 5, 6> factor_change_from_averages() {
  Eigen::Matrix<double, 5, 6> c = Eigen::Matrix<double, 5, 6>::Zero();
  c(0, 0) = 1;            // 11: q1 e1
  c(1, 1) = c(1, 3) = 1;  // 12: q2 e1 + q1 e2
  c(2, 2) = 1;            // 13: e1
  c(3, 4) = 1;            // 22: q2 e2
  c(4, 5) = 1;            // 23: e2
  return c;
}

Eigen::Matrix<double, 5, 5> lens_by_factor_change(const TriangularFactor& p, const TriangularFactor& m) {
  Eigen::Matrix<double, 5, 5> k;
  k << p.a * m.a, 0, 0, 0, 0,                     // fx
      0, 0, 0, p.d * m.d, 0,                      // fy
      p.a * m.c, p.a * m.e, p.a, p.b * m.e, p.b,  // cx
      0, 0, 0, p.d * m.e, p.d,                    // cy
      p.a * m.b, p.a * m.d, 0, p.b * m.d, 0;      // skew
  return -k;
}

}  // namespace raysfm
