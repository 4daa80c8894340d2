#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>
#include <string_view>

#include "raysfm/models/model.h"

namespace raysfm {

// Unified model of Mei and Rives (2007): a sphere, then a pinhole xi behind its centre, then Brown's
// distortion with two radial and two tangential coefficients. As in OpenCV's omnidir (skew 0) and Kalibr's
// omni. With d = |(x, y, z)|:
//
//   m = (x, y) / (z + xi d)
//   u = fx (s mx + 2 p1 mx my + p2 (r^2 + 2 mx^2)) + cx,   s = 1 + k1 r^2 + k2 r^4,  r = |m|
//   v = fy (s my + p1 (r^2 + 2 my^2) + 2 p2 mx my) + cy
//
// xi = 0 is Radtan, 1 a paraboloid mirror.
// Valid set: z > -xi d, for xi > 1 z > -d / xi, and r^2 < max_radius2, the largest disc on which the
// distortion is one-to-one (radial_tangential.h) and, for xi > 1, below 1 / (xi^2 - 1).
// An aggregate: Unified{fx, fy, cx, cy, xi, k1, k2, p1, p2}. max_radius2 follows from the others; build a
// new one rather than assign to a coefficient.
struct Unified {
  static constexpr std::string_view kName = "unified";
  static constexpr size_t kRequired = 5;
  static constexpr std::array<std::string_view, 9> kParameterNames = {"fx", "fy", "cx", "cy", "xi",
                                                                      "k1", "k2", "p1", "p2"};

  double fx = 1, fy = 1, cx = 0, cy = 0, xi = 0;
  double k1 = 0, k2 = 0, p1 = 0, p2 = 0;
  double max_radius2 = valid_radius2(xi, k1, k2, p1, p2);  // |m|^2

  bool project(const Eigen::Vector3d& point, Eigen::Vector2d* pixel,
               Eigen::Matrix<double, 2, 3>* jacobian = nullptr) const;
  bool unproject(const Eigen::Vector2d& pixel, Eigen::Vector3d* direction) const;

  std::optional<ParameterProblem> problem() const;  // xi

  std::array<double, 9> parameters() const { return {fx, fy, cx, cy, xi, k1, k2, p1, p2}; }
  static Unified from_parameters(const std::array<double, 9>& p) {
    return {p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7], p[8]};
  }

 private:
  static double valid_radius2(double xi, double k1, double k2, double p1, double p2);
};

static_assert(CentralModel<Unified> && ProjectiveModel<Unified>);

}  // namespace raysfm
