#include "raysfm/models/ocam.h"

#include <algorithm>
#include <cmath>

namespace raysfm {
namespace {

// f(rho) and f'(rho).
RadiusAtAngle evaluate(const std::array<double, OCam::kMaxCoefficients>& a, int degree, double rho) {
  double value = a[degree], slope = 0;
  for (int i = degree - 1; i >= 0; --i) {
    slope = slope * rho + value;
    value = value * rho + a[i];
  }
  return {value, slope};
}

}  // namespace

int OCam::polynomial_degree(const std::array<double, kMaxCoefficients>& a) {
  int degree = kMaxCoefficients - 1;
  while (degree > 0 && a[degree] == 0) --degree;
  return degree;
}

// The angle atan2(rho, f) rises while f - rho f' > 0. NaN coefficients give 0: nothing is valid then.
double OCam::rising_radius(const std::array<double, kMaxCoefficients>& a, int degree) {
  constexpr int kSteps = 1024;
  const double last = std::atan(100.0);
  const auto rises = [&](double rho) {
    const RadiusAtAngle f = evaluate(a, degree, rho);
    return f.value - rho * f.slope > 0 && std::atan2(rho, f.value) <= kMaxFisheyeAngle;
  };
  if (!(a[0] > 0) || !std::isfinite(a[0])) return 0;
  double good = 0, bad = 0;
  for (int i = 1; i <= kSteps; ++i) {
    bad = a[0] * std::tan(last * i / kSteps);
    if (!rises(bad)) break;
    good = bad;
  }
  for (int i = 0; good < bad && i < 60; ++i) {
    const double middle = 0.5 * (good + bad);
    (rises(middle) ? good : bad) = middle;
  }
  return good;
}

double OCam::angle_at(double rho) const {
  return rho > 0 ? std::atan2(rho, evaluate(a, degree, rho).value) : 0;
}

// From a lens whose radius grows with the angle.
std::array<float, OCam::kAngles + 1> OCam::radii_of_angles() const {
  std::array<float, kAngles + 1> table;
  for (int i = 0; i <= kAngles; ++i) {
    const double share = static_cast<double>(i) / kAngles, theta = share * max_angle;
    table[i] = static_cast<float>(radius_from(share * max_radius, std::sin(theta), std::cos(theta)).value);
  }
  return table;
}

RadiusAtAngle OCam::radius_at(double r, double z, double theta) const {
  const double at = theta / max_angle * kAngles;
  const int cell = std::min(static_cast<int>(at), kAngles - 1);
  return radius_from(radii[cell] + (at - cell) * (radii[cell + 1] - radii[cell]), r, z);
}

// Solves rho z - r f(rho) = 0, whose sign is that of the angle of rho less that of (r, z), by Newton's method
// inside a bracket. Its last step is so short that the next would not be seen.
RadiusAtAngle OCam::radius_from(double start, double r, double z) const {
  constexpr int kMaxIterations = 60;
  double low = 0, high = max_radius;
  double rho = std::min(start, max_radius);
  RadiusAtAngle f = evaluate(a, degree, rho);
  for (int i = 0; i < kMaxIterations; ++i) {
    const double excess = rho * z - r * f.value;
    (excess > 0 ? high : low) = rho;
    double next = rho - excess / (z - r * f.slope);
    if (!(next >= low && next <= high)) next = 0.5 * (low + high);
    const double step = next - rho;
    rho = next;
    if (std::abs(step) <= 1e-8 * max_radius) {
      f.value += f.slope * step;
      break;
    }
    f = evaluate(a, degree, rho);
  }
  return {rho, (rho * rho + f.value * f.value) / (f.value - rho * f.slope)};
}

bool OCam::project(const Eigen::Vector3d& point, Eigen::Vector2d* pixel,
                   Eigen::Matrix<double, 2, 3>* jacobian) const {
  const double distance = point.norm();
  if (!(distance > 0) || !std::isfinite(distance)) return false;
  const double r = std::sqrt(point.x() * point.x() + point.y() * point.y());
  const double theta = std::atan2(r, point.z());
  if (!(theta < max_angle)) return false;
  const RadiusAtAngle rho = radius_at(r / distance, point.z() / distance, theta);
  const Eigen::Vector2d q = radial_projection(point, r, rho, jacobian);
  *pixel = {q.x() + e * q.y() + cx, d * q.x() + c * q.y() + cy};
  if (jacobian) {
    Eigen::Matrix2d affine;
    affine << 1, e, d, c;
    *jacobian = (affine * *jacobian).eval();
  }
  return true;
}

bool OCam::unproject(const Eigen::Vector2d& pixel, Eigen::Vector3d* direction) const {
  const double u = pixel.x() - cx, v = pixel.y() - cy;
  const double inverse = 1 / (c - d * e);
  const Eigen::Vector2d q((c * u - e * v) * inverse, (v - d * u) * inverse);
  const double rho = q.norm();
  if (!(rho < max_radius)) return false;
  *direction = Eigen::Vector3d(q.x(), q.y(), evaluate(a, degree, rho).value).normalized();
  return true;
}

std::optional<ParameterProblem> OCam::problem() const {
  if (!(a[0] > 0 && a[0] <= 1e6)) return ParameterProblem{"a0", a[0], "above 0, at most 1e6"};
  if (!(std::abs(c - d * e) > 1e-3)) return ParameterProblem{"c", c, "not within 0.001 of d e"};
  if (!(max_radius > 0)) return ParameterProblem{"a1", a[1], "coefficients of an angle that rises from 0"};
  return std::nullopt;
}

std::array<double, 5 + OCam::kMaxCoefficients> OCam::parameters() const {
  std::array<double, 5 + kMaxCoefficients> p{cx, cy, c, d, e};
  std::copy(a.begin(), a.end(), p.begin() + 5);
  return p;
}

OCam OCam::from_parameters(const std::array<double, 5 + kMaxCoefficients>& p) {
  std::array<double, kMaxCoefficients> a;
  std::copy(p.begin() + 5, p.end(), a.begin());
  return {p[0], p[1], p[2], p[3], p[4], a};
}

}  // namespace raysfm
