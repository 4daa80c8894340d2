#include "raysfm/solvers/p3p.h"

#include <algorithm>
#include <cmath>

namespace raysfm {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// The triangle seen by the camera: c[k] and a[k] belong to the side opposite to vertex k. Side 0 is the
// longest.
struct Sides {
  std::array<double, 3> c;  // cosine of the angle between the two bearings
  std::array<double, 3> a;  // squared length, scaled so that a[0] = 1
};

// Symmetric 3x3 matrix: diagonal (xx, yy, zz) and off-diagonal.
struct Conic {
  double xx, yy, zz, xy, xz, yz;

  Conic adjugate() const {
    return {yy * zz - yz * yz, xx * zz - xz * xz, xx * yy - xy * xy,
            xz * yz - xy * zz, xy * yz - xz * yy, xy * xz - yz * xx};
  }
  // Trace of the product.
  double dot(const Conic& o) const {
    return xx * o.xx + yy * o.yy + zz * o.zz + 2.0 * (xy * o.xy + xz * o.xz + yz * o.yz);
  }
  Conic plus(double s, const Conic& o) const {
    return {xx + s * o.xx, yy + s * o.yy, zz + s * o.zz, xy + s * o.xy, xz + s * o.xz, yz + s * o.yz};
  }
  double bilinear(const Vector3d& u, const Vector3d& v) const {
    return u.x() * (xx * v.x() + xy * v.y() + xz * v.z()) + u.y() * (xy * v.x() + yy * v.y() + yz * v.z()) +
           u.z() * (xz * v.x() + yz * v.y() + zz * v.z());
  }
};

// A real root of x^3 + b x^2 + c x + d. With three real roots an outer one, where Newton's iteration from
// beyond the turning point is monotone.
double real_cubic_root(double b, double c, double d) {
  const auto value = [&](double x) { return ((x + b) * x + c) * x + d; };
  double x = -b / 3.0;
  const double turning = b * b - 3.0 * c;
  if (turning > 0) {
    const double v = std::sqrt(turning);
    const double left = (-b - v) / 3.0, right = (-b + v) / 3.0;
    const double at_left = value(left);
    // 3 x + b is half the second derivative at a turning point, -v on the left and +v on the right.
    x = at_left > 0 ? left - std::sqrt(at_left / v) : right + std::sqrt(std::max(0.0, -value(right) / v));
  } else if (turning < 0) {
    // Monotone: beyond the root, on the side of the inflection where Newton's steps do not overshoot.
    const double at_inflection = value(x);
    x -= std::copysign(std::min(-3.0 * std::abs(at_inflection) / turning, 1.0 + std::abs(at_inflection)),
                       at_inflection);
  }
  for (int i = 0; i < 30; ++i) {
    const double f = value(x);
    const double slope = (3.0 * x + 2.0 * b) * x + c;
    if (slope == 0) break;
    const double step = f / slope;
    x -= step;
    if (std::abs(step) <= 1e-14 * std::abs(x)) break;
  }
  return x;
}

// The root near zero of a x^3 + b x^2 + c x + d, |d| much smaller than |c|.
double small_cubic_root(double a, double b, double c, double d) {
  double x = 0;
  for (int i = 0; i < 4; ++i) x -= (((a * x + b) * x + c) * x + d) / ((3.0 * a * x + 2.0 * b) * x + c);
  return x;
}

// Splits a conic of rank two into its two lines, conic ~ l m^T + m l^T. False when they are not real.
bool split_lines(const Conic& conic, std::array<Vector3d, 2>* lines) {
  const Conic adjugate = conic.adjugate();  // -(l x m)(l x m)^T
  Vector3d cross;
  if (adjugate.xx <= adjugate.yy && adjugate.xx <= adjugate.zz) {
    cross = {adjugate.xx, adjugate.xy, adjugate.xz};
  } else if (adjugate.yy <= adjugate.zz) {
    cross = {adjugate.xy, adjugate.yy, adjugate.yz};
  } else {
    cross = {adjugate.xz, adjugate.yz, adjugate.zz};
  }
  const double square = -std::min({adjugate.xx, adjugate.yy, adjugate.zz});
  if (!(square > 0)) return false;
  cross /= std::sqrt(square);

  // conic + [l x m]x = 2 m l^T: every row is a multiple of l, every column of m.
  Matrix3d rank_one;
  rank_one << conic.xx, conic.xy - cross.z(), conic.xz + cross.y(),  //
      conic.xy + cross.z(), conic.yy, conic.yz - cross.x(),          //
      conic.xz - cross.y(), conic.yz + cross.x(), conic.zz;
  int row = 0, column = 0;
  double largest = -1;
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      if (std::abs(rank_one(i, j)) > largest) largest = std::abs(rank_one(i, j)), row = i, column = j;
    }
  }
  *lines = {rank_one.row(row).transpose(), rank_one.col(column)};
  return true;
}

// The points where a line meets a conic, up to scale; 0 or 2.
int intersect(const Vector3d& line, const Conic& conic, std::array<Vector3d, 2>* points) {
  const Vector3d size = line.cwiseAbs();
  Vector3d u, v;  // a basis of the line's points
  if (size.x() >= size.y() && size.x() >= size.z()) {
    u = {-line.y(), line.x(), 0}, v = {-line.z(), 0, line.x()};
  } else if (size.y() >= size.z()) {
    u = {line.y(), -line.x(), 0}, v = {0, -line.z(), line.y()};
  } else {
    u = {line.z(), 0, -line.x()}, v = {0, line.z(), -line.y()};
  }
  const double a = conic.bilinear(u, u), b = conic.bilinear(u, v), c = conic.bilinear(v, v);
  const double discriminant = b * b - a * c;
  if (!(discriminant >= 0)) return 0;
  const double q = -(b + std::copysign(std::sqrt(discriminant), b));
  *points = {q * u + a * v, c * u + q * v};
  return 2;
}

// Newton's iteration on the three laws of cosines.
void polish(const Sides& sides, Vector3d* depths) {
  const auto& [c, a] = sides;
  Vector3d& d = *depths;
  for (int i = 0; i < 3; ++i) {
    const double r0 = d[1] * d[1] + d[2] * d[2] - 2.0 * c[0] * d[1] * d[2] - a[0];
    const double r1 = d[0] * d[0] + d[2] * d[2] - 2.0 * c[1] * d[0] * d[2] - a[1];
    const double r2 = d[0] * d[0] + d[1] * d[1] - 2.0 * c[2] * d[0] * d[1] - a[2];
    if (std::abs(r0) + std::abs(r1) + std::abs(r2) < 1e-14) return;
    // Half the Jacobian [0 p q; s 0 t; u v 0] (rows r0, r1, r2).
    const double p = d[1] - c[0] * d[2], q = d[2] - c[0] * d[1];
    const double s = d[0] - c[1] * d[2], t = d[2] - c[1] * d[0];
    const double u = d[0] - c[2] * d[1], v = d[1] - c[2] * d[0];
    const double determinant = p * t * u + q * s * v;
    if (determinant == 0) return;
    const double scale = 0.5 / determinant;
    const Vector3d step =
        scale * Vector3d(-t * v * r0 + q * v * r1 + p * t * r2, t * u * r0 - q * u * r1 + q * s * r2,
                         s * v * r0 + p * u * r1 - p * s * r2);
    if (!(step.squaredNorm() < 0.01 * d.squaredNorm())) return;
    d -= step;
  }
}

// Unit quaternion of a matrix that is a rotation up to rounding.
Eigen::Quaterniond to_quaternion(const Matrix3d& rotation) {
  Eigen::Quaterniond q(rotation);
  q.coeffs() *= 1.5 - 0.5 * q.squaredNorm();
  return q;
}

// Depths that satisfy the three laws of cosines, all positive; at most four.
int solve_depths(const Sides& sides, std::array<Vector3d, 4>* depths) {
  const auto& [c, a] = sides;
  // Law of side k less a_k times the law of side 0, as a conic in the depths.
  const Conic d1 = {1, -a[1], 1 - a[1], 0, -c[1], a[1] * c[0]};
  const Conic d2 = {1, 1 - a[2], -a[2], -c[2], 0, a[2] * c[0]};
  const Conic adjugate1 = d1.adjugate(), adjugate2 = d2.adjugate();
  const double det1 = adjugate1.xx - c[1] * adjugate1.xz, det2 = adjugate2.xx - c[2] * adjugate2.xy;
  const double c1 = adjugate1.dot(d2), c2 = adjugate2.dot(d1);
  // det(d1 + s d2) = det1 + c1 s + c2 s^2 + det2 s^3; solved for s or for 1 / s, whichever is bounded.
  bool reverse = std::abs(det2) < std::abs(det1);
  double s;
  if (std::max(std::abs(det1), std::abs(det2)) > 1e-6 * (std::abs(c1) + std::abs(c2))) {
    s = reverse ? real_cubic_root(c1 / det1, c2 / det1, det2 / det1)
                : real_cubic_root(c2 / det2, c1 / det2, det1 / det2);
  } else {  // Both conics are nearly degenerate, as for an isosceles triangle seen from its axis.
    reverse = std::abs(c1) < std::abs(c2);
    s = reverse ? small_cubic_root(det1, c1, c2, det2) : small_cubic_root(det2, c2, c1, det1);
  }
  const Conic degenerate = reverse ? d2.plus(s, d1) : d1.plus(s, d2);
  std::array<Vector3d, 2> lines, points;
  if (!split_lines(degenerate, &lines)) return 0;
  const Conic& other = reverse == (std::abs(s) < 1) ? d1 : d2;

  int count = 0;
  for (const Vector3d& line : lines) {
    const int found = intersect(line, other, &points);
    for (int i = 0; i < found; ++i) {
      Vector3d d = points[i];
      if (d.sum() < 0) d = -d;
      if (!(d.minCoeff() > 0)) continue;
      // One scale for the three sides together.
      const double perimeter2 =
          2.0 * (d.squaredNorm() - c[0] * d[1] * d[2] - c[1] * d[0] * d[2] - c[2] * d[0] * d[1]);
      d *= std::sqrt((1 + a[1] + a[2]) / perimeter2);
      polish(sides, &d);
      if (d.allFinite() && d.minCoeff() > 0) (*depths)[count++] = d;
    }
  }
  return count;
}

}  // namespace

int p3p(std::span<const Vector3d, 3> bearings, std::span<const Vector3d, 3> points_in_world,
        std::array<Rigid3, 4>* cam_from_world) {
  constexpr double kMinSine2 = 1e-20;       // of the triangle's angles, squared: collinear points
  constexpr double kMaxCosine = 1 - 1e-13;  // of the angle between bearings: coinciding ones
  const std::array<double, 3> lengths2 = {(points_in_world[2] - points_in_world[1]).squaredNorm(),
                                          (points_in_world[2] - points_in_world[0]).squaredNorm(),
                                          (points_in_world[1] - points_in_world[0]).squaredNorm()};
  int first = lengths2[1] > lengths2[0] ? 1 : 0;
  if (lengths2[2] > lengths2[first]) first = 2;
  const int second = first == 2 ? 0 : first + 1, third = first == 0 ? 2 : first - 1;
  const Vector3d &b0 = bearings[first], &b1 = bearings[second], &b2 = bearings[third];
  const double scale2 = lengths2[first];
  const Sides sides = {{b1.dot(b2), b0.dot(b2), b0.dot(b1)},
                       {1, lengths2[second] / scale2, lengths2[third] / scale2}};
  const Vector3d edge1 = points_in_world[second] - points_in_world[first];
  const Vector3d edge2 = points_in_world[third] - points_in_world[first];
  const Vector3d normal = edge1.cross(edge2);
  const double normal2 = normal.squaredNorm();
  if (!(normal2 > kMinSine2 * scale2 * scale2)) return 0;
  if (!(sides.c[0] < kMaxCosine && sides.c[1] < kMaxCosine && sides.c[2] < kMaxCosine)) return 0;

  std::array<Vector3d, 4> depths;
  const int count = solve_depths(sides, &depths);
  if (count == 0) return 0;

  Matrix3d world;  // inverse of (edge1, edge2, normal)
  const Vector3d unit2 = normal / normal2;
  world.row(0) = edge2.cross(unit2);
  world.row(1) = unit2.cross(edge1);
  world.row(2) = unit2;
  const double scale = std::sqrt(scale2);
  for (int i = 0; i < count; ++i) {
    const Vector3d d = scale * depths[i];
    const Vector3d origin = d[0] * b0;
    Matrix3d cam;
    cam.col(0) = d[1] * b1 - origin;
    cam.col(1) = d[2] * b2 - origin;
    cam.col(2) = cam.col(0).cross(cam.col(1));
    const Matrix3d rotation = cam * world;
    (*cam_from_world)[i] = {to_quaternion(rotation), origin - rotation * points_in_world[first]};
  }
  return count;
}

}  // namespace raysfm
