#include "raysfm/models/kannala_brandt.h"

#include <algorithm>

namespace raysfm {

// First zero of d theta_d / d theta, or kMaxFisheyeAngle. NaN coefficients give 0: nothing is valid then.
double KannalaBrandt::rising_angle(double k1, double k2, double k3, double k4) {
  constexpr int kSteps = 512;
  const auto rises = [&](double theta) {
    const double q = theta * theta;
    return 1 + q * (3 * k1 + q * (5 * k2 + q * (7 * k3 + q * 9 * k4))) > 0;
  };
  double good = 0, bad = 0;
  for (int i = 1; i <= kSteps; ++i) {
    bad = kMaxFisheyeAngle * i / kSteps;
    if (!rises(bad)) break;
    good = bad;
  }
  for (int i = 0; good < bad && i < 60; ++i) {
    const double middle = 0.5 * (good + bad);
    (rises(middle) ? good : bad) = middle;
  }
  return good;
}

bool KannalaBrandt::project(const Eigen::Vector3d& point, Eigen::Vector2d* pixel,
                            Eigen::Matrix<double, 2, 3>* jacobian) const {
  const double r = std::sqrt(point.x() * point.x() + point.y() * point.y());
  const double theta = std::atan2(r, point.z());
  // At the origin there is no angle; the sum is finite for finite points only.
  if (!(theta < max_angle) || !(r > 0 || point.z() > 0) || !std::isfinite(r + point.z())) return false;
  const Eigen::Vector2d p = radial_projection(point, r, distorted_angle(theta), jacobian);
  *pixel = {fx * p.x() + cx, fy * p.y() + cy};
  if (jacobian) {
    jacobian->row(0) *= fx;
    jacobian->row(1) *= fy;
  }
  return true;
}

bool KannalaBrandt::unproject(const Eigen::Vector2d& pixel, Eigen::Vector3d* direction) const {
  const Eigen::Vector2d p((pixel.x() - cx) / fx, (pixel.y() - cy) / fy);
  const double radius = p.norm();
  if (!(radius < max_radius)) return false;
  // Newton's method inside the bracket of a rising function.
  constexpr int kMaxIterations = 60;
  double low = 0, high = max_angle;
  double theta = std::min(radius, max_angle);
  for (int i = 0; i < kMaxIterations; ++i) {
    const RadiusAtAngle at = distorted_angle(theta);
    const double excess = at.value - radius;
    (excess > 0 ? high : low) = theta;
    double next = theta - excess / at.slope;
    if (!(next >= low && next <= high)) next = 0.5 * (low + high);
    const bool converged = std::abs(next - theta) <= 1e-15 * max_angle;
    theta = next;
    if (converged) break;
  }
  *direction = direction_at_angle(p, radius, theta);
  return true;
}

}  // namespace raysfm
