#pragma once

#include <Eigen/Core>
#include <limits>

#include "raysfm/models/radial_tangential.h"

namespace raysfm {

// s = 1 + k1 q + k2 q^2 + k3 q^3, q = r^2.
struct RadialPolynomial {
  double k1, k2, k3;
  RadialFactor operator()(double q) const {
    return {1 + q * (k1 + q * (k2 + q * k3)), k1 + q * (2 * k2 + q * 3 * k3)};
  }
};

// Quotient of two such polynomials; negative where the denominator is not positive, which no valid set
// contains.
struct RadialQuotient {
  RadialPolynomial numerator, denominator;
  RadialFactor operator()(double q) const {
    const RadialFactor n = numerator(q), d = denominator(q);
    if (!(d.value > 0)) return {-std::numeric_limits<double>::infinity(), 0};
    const double s = n.value / d.value;
    return {s, (n.slope - s * d.slope) / d.value};
  }
};

// Projection of a model with the members fx, fy, cx, cy, p1, p2, max_radius2 and the given radial factor.
template <typename Model, typename Radial>
bool project_distorted(const Model& model, const Radial& radial, const Eigen::Vector3d& point,
                       Eigen::Vector2d* pixel, Eigen::Matrix<double, 2, 3>* jacobian) {
  if (!(point.z() > 0)) return false;
  const double inverse_z = 1.0 / point.z();
  const Eigen::Vector2d n = point.head<2>() * inverse_z;
  if (!(n.squaredNorm() < model.max_radius2)) return false;
  Eigen::Matrix2d distortion;
  const Eigen::Vector2d d = distort(radial, model.p1, model.p2, n, jacobian ? &distortion : nullptr);
  *pixel = {model.fx * d.x() + model.cx, model.fy * d.y() + model.cy};
  if (jacobian) {
    distortion.row(0) *= model.fx * inverse_z;
    distortion.row(1) *= model.fy * inverse_z;
    *jacobian << distortion, -(distortion * n);
  }
  return true;
}

template <typename Model, typename Radial>
bool unproject_distorted(const Model& model, const Radial& radial, const Eigen::Vector2d& pixel,
                         Eigen::Vector3d* direction) {
  const Eigen::Vector2d d((pixel.x() - model.cx) / model.fx, (pixel.y() - model.cy) / model.fy);
  Eigen::Vector2d n;
  if (!undistort(radial, model.p1, model.p2, model.max_radius2, d, &n)) return false;
  *direction = Eigen::Vector3d(n.x(), n.y(), 1).normalized();
  return true;
}

}  // namespace raysfm
