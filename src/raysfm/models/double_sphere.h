#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>
#include <string_view>

#include "raysfm/models/model.h"

namespace raysfm {

// Double sphere model of Usenko, Demmel and Cremers (2018), their equations 40 to 52:
//
//   d1 = |(x, y, z)|,  z1 = xi d1 + z,  d2 = |(x, y, z1)|,  w = alpha d2 + (1 - alpha) z1
//   u = fx x / w + cx,  v = fy y / w + cy
//
// Valid set: z1 > -w1 d2 with w1 = alpha / (1 - alpha) for alpha <= 0.5, else (1 - alpha) / alpha: up to
// where the image folds back. (The paper's bound on z, their equation 43, is stricter and would leave pixels
// of the disc below without a point.) And |(x, y)| < 1e6 w, so that no pixel is infinite. For alpha > 0.5 the
// pixels with a ray are those of the disc r^2 < 1 / (2 alpha - 1). xi in (-1, 1], alpha in [0, 1].
struct DoubleSphere {
  static constexpr double kMaxRadius = 1e6;  // of pixels, in focal lengths
  static constexpr std::string_view kName = "double-sphere";
  static constexpr size_t kRequired = 6;
  static constexpr std::array<std::string_view, 6> kParameterNames = {"fx", "fy", "cx", "cy", "xi", "alpha"};

  double fx = 1, fy = 1, cx = 0, cy = 0, xi = 0, alpha = 0;

  bool project(const Eigen::Vector3d& point, Eigen::Vector2d* pixel,
               Eigen::Matrix<double, 2, 3>* jacobian = nullptr) const;
  bool unproject(const Eigen::Vector2d& pixel, Eigen::Vector3d* direction) const;

  std::optional<ParameterProblem> problem() const;  // xi, alpha

  std::array<double, 6> parameters() const { return {fx, fy, cx, cy, xi, alpha}; }
  static DoubleSphere from_parameters(const std::array<double, 6>& p) {
    return {p[0], p[1], p[2], p[3], p[4], p[5]};
  }
};

static_assert(CentralModel<DoubleSphere> && ProjectiveModel<DoubleSphere>);

}  // namespace raysfm
