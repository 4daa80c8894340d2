#include "raysfm/geometry/triangulation.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>

namespace raysfm {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr double kMinParallax = 1e-7;  // radians; below it the depth is rounding

// Closest point to all lines in the sense of least squares. The origins are taken relative to the first, so
// that a world far from its origin costs no digits.
bool closest_point(std::span<const Ray> rays, Vector3d* point) {
  Matrix3d a = Matrix3d::Zero();
  Vector3d b = Vector3d::Zero();
  for (const Ray& ray : rays) {
    const Matrix3d off_line = Matrix3d::Identity() - ray.direction * ray.direction.transpose();
    a += off_line;
    b += off_line * (ray.origin - rays[0].origin);
  }
  const Eigen::LDLT<Matrix3d> factor(a);
  if (factor.info() != Eigen::Success) return false;
  *point = rays[0].origin + factor.solve(b);
  return point->allFinite();
}

// Sum of squared tangents of the angles at `point`, with its normal equations: the residual of a ray is
// e = P D / w with D = point - s, w = d^T D, P = I - d d^T, its Jacobian (P - e d^T) / w. False behind an
// origin.
bool angular_cost(std::span<const Ray> rays, const Vector3d& point, double* cost, Matrix3d* hessian,
                  Vector3d* gradient) {
  *cost = 0;
  hessian->setZero();
  gradient->setZero();
  for (const Ray& ray : rays) {
    const Vector3d& d = ray.direction;
    const Vector3d to_point = point - ray.origin;
    const double w = d.dot(to_point);
    if (!(w > 0)) return false;
    const Vector3d e = (to_point - w * d) / w;
    const double e2 = e.squaredNorm();
    const Matrix3d cross = e * d.transpose();
    *cost += e2;
    *hessian += (Matrix3d::Identity() + (e2 - 1) * d * d.transpose() - cross - cross.transpose()) / (w * w);
    *gradient += (e - e2 * d) / w;
  }
  return true;
}

bool refine(std::span<const Ray> rays, Vector3d* point) {
  constexpr int kMaxIterations = 10;
  double cost, next_cost;
  Matrix3d hessian, next_hessian;
  Vector3d gradient, next_gradient;
  if (!angular_cost(rays, *point, &cost, &hessian, &gradient)) return false;
  for (int i = 0; i < kMaxIterations; ++i) {
    const Vector3d next = *point - hessian.ldlt().solve(gradient);
    if (!next.allFinite() || !angular_cost(rays, next, &next_cost, &next_hessian, &next_gradient))
      return true;
    if (!(next_cost < cost)) return true;
    const bool converged = next_cost > (1 - 1e-9) * cost;
    *point = next, cost = next_cost, hessian = next_hessian, gradient = next_gradient;
    if (converged) return true;
  }
  return true;
}

}  // namespace

double angle_between(const Vector3d& unit_a, const Vector3d& unit_b) {
  return 2 * std::atan2((unit_a - unit_b).norm(), (unit_a + unit_b).norm());
}

double largest_parallax(std::span<const Ray> rays) {
  double farthest = 0;
  size_t first = 0, second = 0;
  for (size_t i = 0; i < rays.size(); ++i) {
    for (size_t j = 0; j < i; ++j) {
      const double chord = (rays[i].direction - rays[j].direction).squaredNorm();
      if (chord > farthest) farthest = chord, first = i, second = j;
    }
  }
  return farthest > 0 ? angle_between(rays[first].direction, rays[second].direction) : 0;
}

bool triangulate_midpoint(const Ray& a, const Ray& b, Vector3d* point) {
  const Vector3d baseline = b.origin - a.origin;
  const Vector3d normal = a.direction.cross(b.direction);
  const double sine2 = normal.squaredNorm();
  if (!(sine2 > kMinParallax * kMinParallax)) return false;
  const double depth_a = baseline.cross(b.direction).dot(normal) / sine2;
  const double depth_b = baseline.cross(a.direction).dot(normal) / sine2;
  if (!(depth_a > 0 && depth_b > 0)) return false;
  *point = 0.5 * (a.origin + depth_a * a.direction + b.origin + depth_b * b.direction);
  return true;
}

bool triangulate(std::span<const Ray> rays, Triangulation* result) {
  if (rays.size() < 2) return false;
  result->parallax = largest_parallax(rays);
  const double from_parallel = std::min(result->parallax, std::numbers::pi - result->parallax);
  if (!(from_parallel > kMinParallax)) return false;
  if (!closest_point(rays, &result->point) || !refine(rays, &result->point)) return false;
  double sum2 = 0;
  result->max_angle = 0;
  for (const Ray& ray : rays) {
    const double angle = angle_between((result->point - ray.origin).normalized(), ray.direction);
    sum2 += angle * angle;
    result->max_angle = std::max(result->max_angle, angle);
  }
  result->rms_angle = std::sqrt(sum2 / static_cast<double>(rays.size()));
  return true;
}

}  // namespace raysfm
