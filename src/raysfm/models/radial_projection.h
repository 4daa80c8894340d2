#pragma once

#include <Eigen/Core>
#include <cmath>
#include <numbers>

namespace raysfm {

// No lens sees straight behind itself, where all azimuths meet: fisheye models end this far off the axis.
inline constexpr double kMaxFisheyeAngle = 179.9 * std::numbers::pi / 180;

// Radius rho in the plane at the angle theta off the axis, and its slope d rho / d theta.
struct RadiusAtAngle {
  double value;
  double slope;
};

// The part that models share whose image is a radius as a function of the angle off the axis:
//
//   p = rho(theta) (x, y) / r,  r = |(x, y)|,  theta = atan2(r, z)
//
// `jacobian`, when not null, is dp / d(x, y, z). On the axis, p / (x, y) tends to slope / z.
inline Eigen::Vector2d radial_projection(const Eigen::Vector3d& point, double r, const RadiusAtAngle& rho,
                                         Eigen::Matrix<double, 2, 3>* jacobian) {
  const bool on_axis = r <= 1e-9 * point.z();
  const double scale = on_axis ? rho.slope / point.z() : rho.value / r;
  if (jacobian) {
    const double a = on_axis ? 1 : point.x() / r, b = on_axis ? 0 : point.y() / r;
    const double per_distance = rho.slope / (r * r + point.z() * point.z());
    const double along = per_distance * point.z();  // along the radius; `scale` is across it
    const double mixed = (along - scale) * a * b;
    *jacobian << along * a * a + scale * b * b, mixed, -per_distance * point.x(),  //
        mixed, along * b * b + scale * a * a, -per_distance * point.y();
  }
  return scale * point.head<2>();
}

// Unit vector at the angle theta off the axis, with the azimuth of p; |p| = rho.
inline Eigen::Vector3d direction_at_angle(const Eigen::Vector2d& p, double rho, double theta) {
  if (!(rho > 0)) return Eigen::Vector3d::UnitZ();
  const double s = std::sin(theta) / rho;
  return {s * p.x(), s * p.y(), std::cos(theta)};
}

}  // namespace raysfm
