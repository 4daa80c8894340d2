#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>
#include <string_view>

#include "raysfm/models/model.h"
#include "raysfm/models/radial_projection.h"

namespace raysfm {

// Polynomial model of Scaramuzza, Martinelli and Siegwart (2006), as calibrated by OCamCalib. With q the
// position on the ideal sensor in pixels, x right, y down:
//
//   u = qx + e qy + cx,  v = d qx + c qy + cy
//   ray through (qx, qy, f(rho)),  f(rho) = a0 + a1 rho + a2 rho^2 + ...,  rho = |q|
//
// Here, as everywhere, z is forward, so a0 > 0. OCamCalib's x runs along rows (down), its y along columns
// (right) and its z away from the view: its ss_i is -a_i, its centre (xc, yc) is (cy, cx), and its c, d, e
// are those above. Its a1 is 0. Its inverse polynomial is not used: project() inverts f itself.
//
// Valid set: the angle off the axis is below max_angle, up to where it rises with rho, at most that of
// rho = 100 a0 and 179.9 degrees. A pixel has a ray for rho < max_radius.
// Trailing coefficients of zero change nothing. max_radius and max_angle follow from the others; build a new
// one rather than assign to a coefficient.
struct OCam {
  static constexpr int kMaxCoefficients = 16;
  static constexpr std::string_view kName = "ocam";
  static constexpr size_t kRequired = 6;
  static constexpr std::array<std::string_view, 5 + kMaxCoefficients> kParameterNames = {
      "cx", "cy", "c",  "d",  "e",   "a0",  "a1",  "a2",  "a3",  "a4", "a5",
      "a6", "a7", "a8", "a9", "a10", "a11", "a12", "a13", "a14", "a15"};

  double cx = 0, cy = 0, c = 1, d = 0, e = 0;
  std::array<double, kMaxCoefficients> a{1};  // a0, a1, ...; pixels^(1 - i)

  // Follow from the above.
  int degree = polynomial_degree(a);
  double max_radius = rising_radius(a, degree);  // pixels on the ideal sensor
  double max_angle = angle_at(max_radius);       // radians
  static constexpr int kAngles = 64;
  std::array<float, kAngles + 1> radii =
      radii_of_angles();  // of max_angle times 0, 1/64, ..., 1: to start from

  bool project(const Eigen::Vector3d& point, Eigen::Vector2d* pixel,
               Eigen::Matrix<double, 2, 3>* jacobian = nullptr) const;
  bool unproject(const Eigen::Vector2d& pixel, Eigen::Vector3d* direction) const;

  std::optional<ParameterProblem> problem() const;  // a0 and c - d e

  std::array<double, 5 + kMaxCoefficients> parameters() const;
  static OCam from_parameters(const std::array<double, 5 + kMaxCoefficients>& p);

 private:
  static int polynomial_degree(const std::array<double, kMaxCoefficients>& a);
  static double rising_radius(const std::array<double, kMaxCoefficients>& a, int degree);
  double angle_at(double rho) const;
  std::array<float, kAngles + 1> radii_of_angles() const;
  RadiusAtAngle radius_at(double r, double z, double theta) const;
  RadiusAtAngle radius_from(double start, double r, double z) const;
};

static_assert(CentralModel<OCam> && ProjectiveModel<OCam>);

}  // namespace raysfm
