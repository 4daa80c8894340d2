#pragma once

#include <Eigen/Core>

#include "raysfm/lenses/lens.h"

namespace raysfm {

// Upper triangular 3x3 matrix with 1 below right: [[a, b, c], [0, d, e], [0, 0, 1]], a, d > 0. The triangular
// factors of moments (IFBA01 3.1) and K itself are of this form.
struct TriangularFactor {
  double a = 1, b = 0, c = 0, d = 1, e = 0;

  Eigen::Vector2d operator*(const Eigen::Vector2d& x) const {
    return {a * x.x() + b * x.y() + c, d * x.y() + e};
  }
  TriangularFactor operator*(const TriangularFactor& t) const {
    return {a * t.a, a * t.b + b * t.d, a * t.c + b * t.e + c, d * t.d, d * t.e + e};
  }
  TriangularFactor inverse() const {
    const double ia = 1 / a, id = 1 / d;
    const double ib = -b * ia * id;
    return {ia, ib, -(ia * c + ib * e), id, -id * e};
  }
  // The upper left 2x2.
  Eigen::Matrix2d linear() const { return (Eigen::Matrix2d() << a, b, 0, d).finished(); }
  Lens lens() const { return {a, d, c, e, b}; }
};

// Weighted second moments S = sum w (x, y, 1)^T (x, y, 1) / sum w of points of a plane.
struct Moments {
  double weight = 0, x = 0, y = 0, xx = 0, xy = 0, yy = 0;  // sums

  void add(const Eigen::Vector2d& p, double w) {
    weight += w;
    x += w * p.x();
    y += w * p.y();
    xx += w * p.x() * p.x();
    xy += w * p.x() * p.y();
    yy += w * p.y() * p.y();
  }

  // T with T T^T = S. False when the points lie on a line, up to rounding.
  bool factor(TriangularFactor* t) const;
};

// The T^-1 p have zero mean and unit second moments; a small change dp moves T by T Phi, Phi upper triangular
// with five numbers (11, 12, 13, 22, 23), each an average of products of T^-1 p and T^-1 dp.
using FactorChange = Eigen::Matrix<double, 5, 1>;

// Phi from the six averages f of IntrinsicsFreeProblem: (q1 e1, q2 e1 + q1 e2, e1, q2 e2, e2).
Eigen::Matrix<double, 5, 6> factor_change_from_averages();

// d K / d Phi at K = T_p T_m^-1, when T_m moves: dK = -T_p Phi T_m^-1; rows in the order of LensVector.
Eigen::Matrix<double, 5, 5> lens_by_factor_change(const TriangularFactor& t_p,
                                                  const TriangularFactor& t_m_inverse);

}  // namespace raysfm
