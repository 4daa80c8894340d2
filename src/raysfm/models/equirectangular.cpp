#include "raysfm/models/equirectangular.h"

#include <cmath>
#include <numbers>

namespace raysfm {
namespace {

constexpr double kMinEquatorial = 1e-6;  // sine of the smallest angle to a pole

}  // namespace

bool Equirectangular::project(const Eigen::Vector3d& point, Eigen::Vector2d* pixel,
                              Eigen::Matrix<double, 2, 3>* jacobian) const {
  const double h2 = point.x() * point.x() + point.z() * point.z();
  const double d2 = h2 + point.y() * point.y();
  if (!(h2 > kMinEquatorial * kMinEquatorial * d2) || !std::isfinite(d2)) return false;
  const double h = std::sqrt(h2);
  // atan2(y, h) is asin(y / d), and accurate near the poles as well.
  *pixel = {cx + fx * std::atan2(point.x(), point.z()), cy + fy * std::atan2(point.y(), h)};
  if (jacobian) {
    const double along = -fy * point.y() / (h * d2);
    *jacobian << fx * point.z() / h2, 0, -fx * point.x() / h2,  //
        along * point.x(), fy * h / d2, along * point.z();
  }
  return true;
}

bool Equirectangular::unproject(const Eigen::Vector2d& pixel, Eigen::Vector3d* direction) const {
  const double longitude = (pixel.x() - cx) / fx, latitude = (pixel.y() - cy) / fy;
  if (!(std::abs(longitude) <= 2 * std::numbers::pi)) return false;
  const double c = std::cos(latitude);
  if (!(std::abs(latitude) < std::numbers::pi / 2) || !(c > kMinEquatorial)) return false;
  *direction = {c * std::sin(longitude), std::sin(latitude), c * std::cos(longitude)};
  return true;
}

Equirectangular Equirectangular::for_image(int width, int height) {
  return {width / (2 * std::numbers::pi), height / std::numbers::pi, 0.5 * (width - 1), 0.5 * (height - 1)};
}

}  // namespace raysfm
