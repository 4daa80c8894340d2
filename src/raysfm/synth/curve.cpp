#include "raysfm/synth/curve.h"

#include <cassert>
#include <cmath>

namespace raysfm::synth {

namespace {

// Cox and de Boor on unit knots: the `degree` + 1 weights that are not zero, for the fraction x in [0, 1).
void basis(double x, int degree, double* weight) {
  weight[0] = 1.0;
  for (int d = 1; d <= degree; ++d) {
    weight[d] = x * weight[d - 1] / d;
    for (int i = d - 1; i >= 1; --i) weight[i] = ((x + d - i) * weight[i - 1] + (1 + i - x) * weight[i]) / d;
    weight[0] = (1.0 - x) * weight[0] / d;
  }
}

}  // namespace

Curve::Curve(std::vector<Eigen::Vector3d> points, bool closed) : points_(std::move(points)), closed_(closed) {
  assert(points_.size() >= 2);
}

Eigen::Vector3d Curve::point(long i) const {
  const long n = static_cast<long>(points_.size());
  if (closed_) return points_[static_cast<size_t>(((i % n) + n) % n)];
  if (i < 0) return points_[0] + static_cast<double>(i) * (points_[1] - points_[0]);
  if (i >= n) return points_[n - 1] + static_cast<double>(i - n + 1) * (points_[n - 1] - points_[n - 2]);
  return points_[static_cast<size_t>(i)];
}

Eigen::Vector3d Curve::position(double x) const {
  // The basis function of control point i has its middle at i, so five degrees reach from i - 3 to i + 3.
  const double whole = std::floor(x);
  double weight[6];
  basis(x - whole, 5, weight);
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (int k = 0; k < 6; ++k) sum += weight[k] * point(static_cast<long>(whole) - 2 + k);
  return sum;
}

Eigen::Vector3d Curve::derivative(double x) const {
  const double whole = std::floor(x);
  double weight[5];
  basis(x - whole, 4, weight);
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (int k = 0; k < 5; ++k) {
    const long i = static_cast<long>(whole) - 2 + k;
    sum += weight[k] * (point(i + 1) - point(i));
  }
  return sum;
}

}  // namespace raysfm::synth
