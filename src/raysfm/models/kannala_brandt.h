#pragma once

#include <Eigen/Core>
#include <array>
#include <cmath>
#include <string_view>

#include "raysfm/models/model.h"
#include "raysfm/models/radial_projection.h"

namespace raysfm {

// Fisheye camera of Kannala and Brandt (2006) with four coefficients, as in OpenCV's fisheye module and
// Kalibr's equidistant. With r = |(x, y)|, theta = atan2(r, z):
//
//   theta_d = theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8)
//   u = fx theta_d x / r + cx,  v = fy theta_d y / r + cy
//
// Valid set: theta < max_angle, up to where theta_d rises, at most 179.9 degrees; so the camera may see
// behind itself. A pixel has a ray where theta_d stays below that of max_angle.
// An aggregate: KannalaBrandt{fx, fy, cx, cy, k1, k2, k3, k4}. max_angle and max_radius follow from the
// others; build a new one rather than assign to a coefficient.
struct KannalaBrandt {
  static constexpr std::string_view kName = "kannala-brandt";
  static constexpr size_t kRequired = 4;
  static constexpr std::array<std::string_view, 8> kParameterNames = {"fx", "fy", "cx", "cy",
                                                                      "k1", "k2", "k3", "k4"};

  double fx = 1, fy = 1, cx = 0, cy = 0;
  double k1 = 0, k2 = 0, k3 = 0, k4 = 0;
  double max_angle = rising_angle(k1, k2, k3, k4);       // radians
  double max_radius = distorted_angle(max_angle).value;  // theta_d there

  bool project(const Eigen::Vector3d& point, Eigen::Vector2d* pixel,
               Eigen::Matrix<double, 2, 3>* jacobian = nullptr) const;
  bool unproject(const Eigen::Vector2d& pixel, Eigen::Vector3d* direction) const;

  std::array<double, 8> parameters() const { return {fx, fy, cx, cy, k1, k2, k3, k4}; }
  static KannalaBrandt from_parameters(const std::array<double, 8>& p) {
    return {p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7]};
  }

  // theta_d and its derivative.
  RadiusAtAngle distorted_angle(double theta) const {
    const double q = theta * theta;
    return {theta * (1 + q * (k1 + q * (k2 + q * (k3 + q * k4)))),
            1 + q * (3 * k1 + q * (5 * k2 + q * (7 * k3 + q * 9 * k4)))};
  }

 private:
  static double rising_angle(double k1, double k2, double k3, double k4);
};

static_assert(CentralModel<KannalaBrandt> && ProjectiveModel<KannalaBrandt>);

}  // namespace raysfm
