#include "raysfm/models/unified.h"

#include <algorithm>
#include <cmath>

#include "raysfm/models/distorted_perspective.h"

namespace raysfm {

double Unified::valid_radius2(double xi, double k1, double k2, double p1, double p2) {
  const double one_to_one = one_to_one_radius2(RadialPolynomial{k1, k2, 0}, p1, p2);
  if (!(xi >= 0)) return 0;
  return xi > 1 ? std::min(one_to_one, 1 / (xi * xi - 1)) : one_to_one;
}

bool Unified::project(const Eigen::Vector3d& point, Eigen::Vector2d* pixel,
                      Eigen::Matrix<double, 2, 3>* jacobian) const {
  const double d = point.norm();
  if (!(d > 0) || !std::isfinite(d)) return false;
  const double w = point.z() + xi * d;
  if (!(w > 0) || !(xi * point.z() > -d)) return false;
  const double inverse_w = 1 / w;
  const Eigen::Vector2d m = point.head<2>() * inverse_w;
  if (!(m.squaredNorm() < max_radius2)) return false;
  Eigen::Matrix2d distortion;
  const Eigen::Vector2d distorted =
      distort(RadialPolynomial{k1, k2, 0}, p1, p2, m, jacobian ? &distortion : nullptr);
  *pixel = {fx * distorted.x() + cx, fy * distorted.y() + cy};
  if (jacobian) {
    distortion.row(0) *= fx * inverse_w;
    distortion.row(1) *= fy * inverse_w;
    Eigen::RowVector3d dw = (xi / d) * point.transpose();
    dw.z() += 1;
    *jacobian = -(distortion * m) * dw;
    jacobian->leftCols<2>() += distortion;
  }
  return true;
}

bool Unified::unproject(const Eigen::Vector2d& pixel, Eigen::Vector3d* direction) const {
  const Eigen::Vector2d distorted((pixel.x() - cx) / fx, (pixel.y() - cy) / fy);
  Eigen::Vector2d m;
  if (!undistort(RadialPolynomial{k1, k2, 0}, p1, p2, max_radius2, distorted, &m)) return false;
  const double r2 = m.squaredNorm();
  const double root = 1 + (1 - xi * xi) * r2;
  if (!(root >= 0)) return false;
  const double eta = (xi + std::sqrt(root)) / (1 + r2);
  *direction = Eigen::Vector3d(eta * m.x(), eta * m.y(), eta - xi).normalized();
  return true;
}

std::optional<ParameterProblem> Unified::problem() const {
  if (!(xi >= 0 && xi <= 1e3)) return ParameterProblem{"xi", xi, "between 0 and 1000"};
  return std::nullopt;
}

}  // namespace raysfm
