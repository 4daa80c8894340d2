#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>

namespace raysfm {

// Radial factor s of a distortion at the squared radius q = r^2, and its slope ds/dq.
struct RadialFactor {
  double value;
  double slope;
};

// The part that Radtan and Rational share: radial and tangential distortion of normalised coordinates
// n = (x, y) = (X / Z, Y / Z), with r = |n| and p = (p2, p1):
//
//   d(n) = s(r^2) n + r^2 p + 2 (p . n) n
//
// which written out is Brown's model, x' = s x + 2 p1 x y + p2 (r^2 + 2 x^2), y' = s y + p1 (r^2 + 2 y^2) +
// 2 p2 x y. d is the gradient of a scalar, so its Jacobian is symmetric. The eigenvalues of the radial part
// are s and g' = d(r s)/dr, those of the tangential part are 4 (p . n) +- 2 |p| r >= -6 |p| r. Where
//
//   min(s, g') > 6 |p| r
//
// the Jacobian is therefore positive definite, and on a disc of such points d is one-to-one. The largest such
// disc is the valid set of the models.
//
// `Radial` is callable: squared radius to RadialFactor.
template <typename Radial>
inline Eigen::Vector2d distort(const Radial& radial, double p1, double p2, const Eigen::Vector2d& n,
                               Eigen::Matrix2d* jacobian) {
  const double x = n.x(), y = n.y();
  const double q = x * x + y * y;
  const double pn = p2 * x + p1 * y;
  const RadialFactor s = radial(q);
  if (jacobian) {
    const double diagonal = s.value + 2 * pn;
    const double off_diagonal = 2 * (s.slope * x * y + p1 * x + p2 * y);
    *jacobian << diagonal + 2 * s.slope * x * x + 4 * p2 * x, off_diagonal,  //
        off_diagonal, diagonal + 2 * s.slope * y * y + 4 * p1 * y;
  }
  return {(s.value + 2 * pn) * x + p2 * q, (s.value + 2 * pn) * y + p1 * q};
}

// Squared radius of the largest disc on which the distortion is provably one-to-one (see above), at most that
// of a ray 89.9 degrees off the axis. Costs some microseconds: call it once per camera.
template <typename Radial>
double one_to_one_radius2(const Radial& radial, double p1, double p2) {
  constexpr double kMaxAngle = 89.9 * 3.14159265358979323846 / 180;
  constexpr int kSteps = 1024;
  const double tangential = 6 * std::hypot(p1, p2);
  const auto one_to_one = [&](double angle) {
    const double r = std::tan(angle);
    const RadialFactor s = radial(r * r);
    return std::min(s.value, s.value + 2 * r * r * s.slope) > tangential * r;
  };
  double good = 0, bad = kMaxAngle;
  int step = 1;
  for (; step <= kSteps && one_to_one(kMaxAngle * step / kSteps); ++step) good = kMaxAngle * step / kSteps;
  if (step <= kSteps) {
    bad = kMaxAngle * step / kSteps;
    for (int i = 0; i < 60; ++i) {
      const double middle = 0.5 * (good + bad);
      (one_to_one(middle) ? good : bad) = middle;
    }
  }
  return std::pow(std::tan(good), 2);
}

constexpr double kUndistorted = 1e-13;  // of |n|, relative above 1
constexpr int kMaxUndistortions = 50;

// Solves r s(r^2) = d for r below the root of `radius2`, likewise. d: not negative.
template <typename Radial>
bool undistort_radius(const Radial& radial, double radius2, double d, double* r) {
  double x = d * d < radius2 ? d : 0.95 * std::sqrt(radius2);
  RadialFactor s = radial(x * x);
  double residual = x * s.value - d;
  for (int i = 0; i < kMaxUndistortions; ++i) {
    double step = residual / (s.value + 2 * x * x * s.slope);
    if (!std::isfinite(step)) return false;
    const double size = std::abs(step) / std::max(1.0, x);
    if (size <= kUndistorted) {
      *r = x;
      return true;
    }
    for (const double least = 1e-6 * std::abs(step);; step *= 0.5) {
      if (std::abs(step) < least) return false;
      const double next = x - step;
      if (next < 0 || !(next * next < radius2)) continue;
      s = radial(next * next);
      const double next_residual = next * s.value - d;
      // Rounding keeps a residual from falling further.
      if (!(std::abs(next_residual) < std::abs(residual)) && size >= 1e-9) continue;
      x = next;
      residual = next_residual;
      break;
    }
  }
  return false;
}

// Solves distort(n) = d for n in the disc of squared radius `radius2`, by Newton's method whose steps are
// halved until they stay in the disc and bring the residual down. False where there is no solution.
template <typename Radial>
bool undistort(const Radial& radial, double p1, double p2, double radius2, const Eigen::Vector2d& d,
               Eigen::Vector2d* n) {
  if (!d.allFinite()) return false;
  if (p1 == 0 && p2 == 0) {
    const double length = d.norm();
    double radius;
    if (!undistort_radius(radial, radius2, length, &radius)) return false;
    *n = length > 0 ? Eigen::Vector2d(radius / length * d) : d;
    return true;
  }
  Eigen::Vector2d x = d;
  if (!(d.squaredNorm() < radius2)) x *= 0.95 * std::sqrt(radius2) / d.norm();
  Eigen::Matrix2d jacobian;
  Eigen::Vector2d residual = distort(radial, p1, p2, x, &jacobian) - d;
  for (int i = 0; i < kMaxUndistortions; ++i) {
    const double a = jacobian(0, 0), b = jacobian(0, 1), c = jacobian(1, 1);
    Eigen::Vector2d step(c * residual.x() - b * residual.y(), a * residual.y() - b * residual.x());
    step /= a * c - b * b;
    const double step_size = step.norm();
    if (!std::isfinite(step_size)) return false;
    const bool converged = step_size <= kUndistorted * std::max(1.0, x.norm());
    double scale = 1;
    Eigen::Vector2d next = x - step;
    Eigen::Vector2d next_residual = residual;
    for (;; scale *= 0.5, next = x - scale * step) {
      if (scale < 1e-6) return false;
      if (!(next.squaredNorm() < radius2)) continue;
      next_residual = distort(radial, p1, p2, next, &jacobian) - d;
      if (converged || next_residual.squaredNorm() < residual.squaredNorm()) break;
      if (step_size < 1e-9 * std::max(1.0, x.norm())) break;  // rounding keeps the residual from falling
    }
    x = next;
    residual = next_residual;
    if (converged) {
      *n = x;
      return true;
    }
  }
  return false;
}

}  // namespace raysfm
