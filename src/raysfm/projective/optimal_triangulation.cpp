#include "raysfm/projective/optimal_triangulation.h"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <Eigen/SVD>
#include <array>
#include <cmath>

#include "raysfm/geometry/rotation.h"
#include "raysfm/solvers/polynomial_roots.h"

namespace raysfm {
namespace {

struct SortedMatch {
  double a, b, c, d, f,
      g;  // as in the paper: F = [[ffgd, -fgc, -fgd], [-fb, a, b], [-fd, c, d]], f and g of the epipoles
};

// The polynomial whose roots are the stationary epipolar lines, coefficients ascending, degree 6:
// t ((at + b)^2 + g^2 (ct + d)^2)^2 - (ad - bc)(1 + f^2 t^2)^2 (at + b)(ct + d).
std::array<double, 7> stationary_lines(const SortedMatch& m) {
  const double q0 = m.b * m.b + m.g * m.g * m.d * m.d, q1 = 2 * (m.a * m.b + m.g * m.g * m.c * m.d),
               q2 = m.a * m.a + m.g * m.g * m.c * m.c;
  const std::array<double, 5> squared = {q0 * q0, 2 * q0 * q1, q1 * q1 + 2 * q0 * q2, 2 * q1 * q2, q2 * q2};
  const double r0 = m.b * m.d, r1 = m.a * m.d + m.b * m.c, r2 = m.a * m.c, f2 = m.f * m.f;
  const std::array<double, 3> product = {r0, r1, r2}, even = {1, 2 * f2, f2 * f2};
  const double determinant = m.a * m.d - m.b * m.c;
  std::array<double, 7> p{};
  for (int i = 0; i < 5; ++i) p[i + 1] += squared[i];
  for (int i = 0; i < 3; ++i) {
    for (int k = 0; k < 3; ++k) p[2 * i + k] -= determinant * even[i] * product[k];
  }
  return p;
}

double line_cost(const SortedMatch& m, double t) {
  const double top = m.c * t + m.d, left = m.a * t + m.b;
  return t * t / (1 + m.f * m.f * t * t) + top * top / (left * left + m.g * m.g * top * top);
}

// The rotation about the origin that brings the epipole e to (1, 0, *).
Eigen::Matrix3d epipole_to_axis(const Eigen::Vector3d& e) {
  Eigen::Matrix3d r;
  r << e.x(), e.y(), 0, -e.y(), e.x(), 0, 0, 0, 1;
  return r;
}

Eigen::Vector2d closest_to_origin(const Eigen::Vector3d& line) {
  return -line.z() * line.head<2>() / line.head<2>().squaredNorm();
}

}  // namespace

bool correct_match(const Eigen::Matrix3d& fundamental, Eigen::Vector2d* a, Eigen::Vector2d* b) {
  Eigen::Matrix3d to_a = Eigen::Matrix3d::Identity(), to_b = Eigen::Matrix3d::Identity();
  to_a.topRightCorner<2, 1>() = *a;
  to_b.topRightCorner<2, 1>() = *b;
  const Eigen::Matrix3d centred = to_b.transpose() * fundamental * to_a;
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(centred, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Vector3d e_a = svd.matrixV().col(2), e_b = svd.matrixU().col(2);
  const double n_a = e_a.head<2>().norm(), n_b = e_b.head<2>().norm();
  if (!(n_a > 1e-12 && n_b > 1e-12)) return false;
  e_a /= n_a;
  e_b /= n_b;
  const Eigen::Matrix3d r_a = epipole_to_axis(e_a), r_b = epipole_to_axis(e_b);
  const Eigen::Matrix3d f = (r_b * centred * r_a.transpose()).normalized();
  const SortedMatch m{f(1, 1), f(1, 2), f(2, 1), f(2, 2), e_a.z(), e_b.z()};
  const std::array<double, 7> polynomial = stationary_lines(m);
  double roots[kMaxRootDegree];
  const int count = real_roots(polynomial, roots);
  double best = 0, best_cost = INFINITY;
  for (int i = 0; i < count; ++i) {
    const double cost = line_cost(m, roots[i]);
    if (cost < best_cost) best = roots[i], best_cost = cost;
  }
  if (!std::isfinite(best_cost)) return false;
  const Eigen::Vector3d line_a(best * m.f, 1, -best);
  const Eigen::Vector3d line_b = f * Eigen::Vector3d(0, best, 1);
  *a += r_a.topLeftCorner<2, 2>().transpose() * closest_to_origin(line_a);
  *b += r_b.topLeftCorner<2, 2>().transpose() * closest_to_origin(line_b);
  return a->allFinite() && b->allFinite();
}

bool triangulate_projective(std::span<const Matrix34d> views, std::span<const Eigen::Vector2d> pixels,
                            Eigen::Vector4d* point) {
  if (views.size() < 2) return false;
  for (int round = 0; round < 2; ++round) {
    Eigen::Matrix4d normal = Eigen::Matrix4d::Zero();
    for (size_t i = 0; i < views.size(); ++i) {
      const double depth = round == 0 ? views[i].row(2).norm() : std::abs(views[i].row(2).dot(*point));
      const double weight = 1 / std::max(depth, 1e-12);
      for (int axis = 0; axis < 2; ++axis) {
        const Eigen::Vector4d row =
            weight * (pixels[i][axis] * views[i].row(2) - views[i].row(axis)).transpose();
        normal.noalias() += row * row.transpose();
      }
    }
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix4d> eigen(normal);
    *point = eigen.eigenvectors().col(0);
  }
  return point->allFinite();
}

Matrix34d second_view(const Eigen::Matrix3d& fundamental) {
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(fundamental, Eigen::ComputeFullU);
  const Eigen::Vector3d epipole = svd.matrixU().col(2);
  Matrix34d view;
  view.leftCols<3>() = skew(epipole) * fundamental;
  view.col(3) = epipole;
  return view;
}

}  // namespace raysfm
