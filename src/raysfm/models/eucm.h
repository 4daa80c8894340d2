#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>
#include <string_view>

#include "raysfm/models/model.h"

namespace raysfm {

// Extended unified camera model of Khomutenko, Garcia and Martinet (2016), in the form of Usenko, Demmel and
// Cremers (2018), their equations 14 to 23:
//
//   d = sqrt(beta (x^2 + y^2) + z^2),  w = alpha d + (1 - alpha) z
//   u = fx x / w + cx,  v = fy y / w + cy
//
// Valid set: z > -w1 d with w1 = alpha / (1 - alpha) for alpha <= 0.5, else (1 - alpha) / alpha; and
// |(x, y)| < 1e6 w, so that no pixel is infinite. For alpha > 0.5 the pixels with a ray are those of the disc
// r^2 < 1 / (beta (2 alpha - 1)).
// alpha in [0, 1], beta > 0.
struct Eucm {
  static constexpr double kMaxRadius = 1e6;  // of pixels, in focal lengths
  static constexpr std::string_view kName = "eucm";
  static constexpr size_t kRequired = 6;
  static constexpr std::array<std::string_view, 6> kParameterNames = {"fx", "fy",    "cx",
                                                                      "cy", "alpha", "beta"};

  double fx = 1, fy = 1, cx = 0, cy = 0, alpha = 0, beta = 1;

  bool project(const Eigen::Vector3d& point, Eigen::Vector2d* pixel,
               Eigen::Matrix<double, 2, 3>* jacobian = nullptr) const;
  bool unproject(const Eigen::Vector2d& pixel, Eigen::Vector3d* direction) const;

  std::optional<ParameterProblem> problem() const;  // alpha, beta

  std::array<double, 6> parameters() const { return {fx, fy, cx, cy, alpha, beta}; }
  static Eucm from_parameters(const std::array<double, 6>& p) { return {p[0], p[1], p[2], p[3], p[4], p[5]}; }
};

static_assert(CentralModel<Eucm> && ProjectiveModel<Eucm>);

}  // namespace raysfm
