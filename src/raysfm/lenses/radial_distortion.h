#pragma once

#include <Eigen/Core>

namespace raysfm {

// The point m of the normalised image plane is seen where an ideal lens would see m (1 + k1 r^2 + k2 r^4),
// r = |m|.
struct RadialDistortion {
  double k1 = 0, k2 = 0;

  bool none() const { return k1 == 0 && k2 == 0; }
  double factor(double r2) const { return 1 + r2 * (k1 + r2 * k2); }
  Eigen::Vector2d operator()(const Eigen::Vector2d& m) const { return factor(m.squaredNorm()) * m; }
  // d operator()(m) / d m.
  Eigen::Matrix2d jacobian(const Eigen::Vector2d& m) const {
    const double r2 = m.squaredNorm();
    return factor(r2) * Eigen::Matrix2d::Identity() + 2 * (k1 + 2 * r2 * k2) * m * m.transpose();
  }
};

}  // namespace raysfm
