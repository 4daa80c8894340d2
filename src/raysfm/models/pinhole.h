#pragma once

#include <Eigen/Core>
#include <array>
#include <cmath>
#include <string_view>

#include "raysfm/models/model.h"

namespace raysfm {

// Perspective camera without distortion.
//
//   u = fx x / z + cx,  v = fy y / z + cy
//
// Valid set: z > 0 and |(x, y)| < 1e6 z, so that no pixel is infinite. Every pixel of an image has a ray.
// fx, fy > 0 and cx, cy in pixels, (0, 0) being the centre of the top-left pixel.
struct Pinhole {
  static constexpr std::string_view kName = "pinhole";
  static constexpr size_t kRequired = 4;
  static constexpr std::array<std::string_view, 4> kParameterNames = {"fx", "fy", "cx", "cy"};
  static constexpr double kMaxRadius = 1e6;  // |(x, y)| / z

  double fx = 1, fy = 1, cx = 0, cy = 0;

  bool project(const Eigen::Vector3d& point, Eigen::Vector2d* pixel,
               Eigen::Matrix<double, 2, 3>* jacobian = nullptr) const {
    if (!(point.z() > 0)) return false;
    const double inverse_z = 1.0 / point.z();
    const double x = point.x() * inverse_z;
    const double y = point.y() * inverse_z;
    if (!(x * x + y * y < kMaxRadius * kMaxRadius)) return false;
    *pixel = {fx * x + cx, fy * y + cy};
    if (jacobian) *jacobian << fx * inverse_z, 0, -fx * x * inverse_z, 0, fy * inverse_z, -fy * y * inverse_z;
    return true;
  }

  bool unproject(const Eigen::Vector2d& pixel, Eigen::Vector3d* direction) const {
    const double x = (pixel.x() - cx) / fx;
    const double y = (pixel.y() - cy) / fy;
    if (!(x * x + y * y < kMaxRadius * kMaxRadius)) return false;
    *direction = Eigen::Vector3d(x, y, 1).normalized();
    return true;
  }

  std::array<double, 4> parameters() const { return {fx, fy, cx, cy}; }
  static Pinhole from_parameters(const std::array<double, 4>& p) { return {p[0], p[1], p[2], p[3]}; }
};

static_assert(CentralModel<Pinhole> && ProjectiveModel<Pinhole>);

}  // namespace raysfm
