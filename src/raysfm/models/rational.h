#pragma once

#include <Eigen/Core>
#include <array>
#include <string_view>

#include "raysfm/models/distorted_perspective.h"
#include "raysfm/models/model.h"

namespace raysfm {

// Perspective camera with rational radial and tangential distortion (OpenCV's eight coefficients, COLMAP's
// FULL_OPENCV). With x = X / Z, y = Y / Z, r^2 = x^2 + y^2:
//
//   s = (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 + k6 r^6)
//   u = fx (s x + 2 p1 x y + p2 (r^2 + 2 x^2)) + cx
//   v = fy (s y + p1 (r^2 + 2 y^2) + 2 p2 x y) + cy
//
// Valid set: Z > 0 and r^2 < max_radius2, the largest disc on which the denominator is positive and the
// distortion one-to-one (radial_tangential.h).
// An aggregate in OpenCV's order: Rational{fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, k5, k6}. max_radius2
// follows from the others; build a new Rational rather than assign to a coefficient.
struct Rational {
  static constexpr std::string_view kName = "rational";
  static constexpr size_t kRequired = 12;
  static constexpr std::array<std::string_view, 12> kParameterNames = {"fx", "fy", "cx", "cy", "k1", "k2",
                                                                       "p1", "p2", "k3", "k4", "k5", "k6"};

  double fx = 1, fy = 1, cx = 0, cy = 0;
  double k1 = 0, k2 = 0, p1 = 0, p2 = 0, k3 = 0, k4 = 0, k5 = 0, k6 = 0;
  double max_radius2 = one_to_one_radius2(RadialQuotient{{k1, k2, k3}, {k4, k5, k6}}, p1, p2);

  bool project(const Eigen::Vector3d& point, Eigen::Vector2d* pixel,
               Eigen::Matrix<double, 2, 3>* jacobian = nullptr) const {
    return project_distorted(*this, RadialQuotient{{k1, k2, k3}, {k4, k5, k6}}, point, pixel, jacobian);
  }

  bool unproject(const Eigen::Vector2d& pixel, Eigen::Vector3d* direction) const {
    return unproject_distorted(*this, RadialQuotient{{k1, k2, k3}, {k4, k5, k6}}, pixel, direction);
  }

  std::array<double, 12> parameters() const { return {fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, k5, k6}; }
  static Rational from_parameters(const std::array<double, 12>& p) {
    return {p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7], p[8], p[9], p[10], p[11]};
  }
};

static_assert(CentralModel<Rational> && ProjectiveModel<Rational>);

}  // namespace raysfm
