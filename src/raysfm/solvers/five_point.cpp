#include "raysfm/solvers/five_point.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "raysfm/solvers/polynomial_roots.h"

namespace raysfm {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// The unknown essential matrix is E = x basis[0] + y basis[1] + z basis[2] + basis[3].
using Basis = std::array<Matrix3d, 4>;

// Polynomials in (x, y, z) by their coefficients, in the order of these monomials:
using Linear = std::array<double, 4>;      // x y z 1
using Quadratic = std::array<double, 10>;  // xx xy yy xz yz zz x y z 1
// Cubics are rows of the elimination, in the order of Nister (2004, 3.2.3) with x^3 ... xy first, so that ten
// columns are eliminated and what remains is of low degree in x and y:
//   0 xxx  1 yyy  2 xxy  3 xyy  4 xxz  5 xx  6 yyz  7 yy  8 xyz  9 xy
//   10 xzz 11 xz 12 x  13 yzz 14 yz 15 y  16 zzz 17 zz 18 z 19 1
using Cubic = std::array<double, 20>;
using Cubics = std::array<Cubic, 10>;

void add_product(const Linear& a, const Linear& b, double sign, Quadratic* out) {
  Quadratic& q = *out;
  q[0] += sign * (a[0] * b[0]);
  q[1] += sign * (a[0] * b[1] + a[1] * b[0]);
  q[2] += sign * (a[1] * b[1]);
  q[3] += sign * (a[0] * b[2] + a[2] * b[0]);
  q[4] += sign * (a[1] * b[2] + a[2] * b[1]);
  q[5] += sign * (a[2] * b[2]);
  q[6] += sign * (a[0] * b[3] + a[3] * b[0]);
  q[7] += sign * (a[1] * b[3] + a[3] * b[1]);
  q[8] += sign * (a[2] * b[3] + a[3] * b[2]);
  q[9] += sign * (a[3] * b[3]);
}

void add_product(const Quadratic& a, const Linear& b, Cubic* out) {
  Cubic& c = *out;
  c[0] += a[0] * b[0];
  c[1] += a[2] * b[1];
  c[2] += a[0] * b[1] + a[1] * b[0];
  c[3] += a[1] * b[1] + a[2] * b[0];
  c[4] += a[0] * b[2] + a[3] * b[0];
  c[5] += a[0] * b[3] + a[6] * b[0];
  c[6] += a[2] * b[2] + a[4] * b[1];
  c[7] += a[2] * b[3] + a[7] * b[1];
  c[8] += a[1] * b[2] + a[3] * b[1] + a[4] * b[0];
  c[9] += a[1] * b[3] + a[6] * b[1] + a[7] * b[0];
  c[10] += a[3] * b[2] + a[5] * b[0];
  c[11] += a[3] * b[3] + a[6] * b[2] + a[8] * b[0];
  c[12] += a[6] * b[3] + a[9] * b[0];
  c[13] += a[4] * b[2] + a[5] * b[1];
  c[14] += a[4] * b[3] + a[7] * b[2] + a[8] * b[1];
  c[15] += a[7] * b[3] + a[9] * b[1];
  c[16] += a[5] * b[2];
  c[17] += a[5] * b[3] + a[8] * b[2];
  c[18] += a[8] * b[3] + a[9] * b[2];
  c[19] += a[9] * b[3];
}

// Orthonormal basis of the matrices with b1^T E b0 = 0 for the five matches, by Householder reflections of
// the 9x5 system. False when the five equations are dependent.
bool null_space(std::span<const Vector3d, 5> bearings0, std::span<const Vector3d, 5> bearings1,
                Basis* basis) {
  constexpr double kMinPivot = 1e-10;
  double v[5][9];  // column k of the system; from row k on, reflector k
  for (int k = 0; k < 5; ++k) {
    // E is stored by columns: entry (row, column) at 3 * column + row.
    for (int i = 0; i < 9; ++i) v[k][i] = bearings0[k][i / 3] * bearings1[k][i % 3];
  }
  double beta[5];  // 2 / |v|^2
  for (int k = 0; k < 5; ++k) {
    double norm2 = 0;
    for (int i = k; i < 9; ++i) norm2 += v[k][i] * v[k][i];
    if (!(norm2 > kMinPivot * kMinPivot)) return false;
    const double norm = std::sqrt(norm2);
    beta[k] = 1.0 / (norm2 + norm * std::abs(v[k][k]));
    v[k][k] += std::copysign(norm, v[k][k]);
    for (int j = k + 1; j < 5; ++j) {
      double dot = 0;
      for (int i = k; i < 9; ++i) dot += v[k][i] * v[j][i];
      dot *= beta[k];
      for (int i = k; i < 9; ++i) v[j][i] -= dot * v[k][i];
    }
  }
  for (int b = 0; b < 4; ++b) {
    double* e = (*basis)[b].data();
    std::fill_n(e, 9, 0.0);
    e[5 + b] = 1;
    for (int k = 4; k >= 0; --k) {
      double dot = 0;
      for (int i = k; i < 9; ++i) dot += v[k][i] * e[i];
      dot *= beta[k];
      for (int i = k; i < 9; ++i) e[i] -= dot * v[k][i];
    }
  }
  return true;
}

// The ten cubic constraints: (E E^T - trace(E E^T) / 2) E = 0 and det E = 0.
void essential_constraints(const Basis& basis, Cubics* constraints) {
  Linear e[3][3];
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      for (int b = 0; b < 4; ++b) e[i][j][b] = basis[b](i, j);
    }
  }
  Quadratic square[3][3];  // E E^T - trace / 2
  for (int i = 0; i < 3; ++i) {
    for (int j = i; j < 3; ++j) {
      square[i][j] = {};
      for (int k = 0; k < 3; ++k) add_product(e[i][k], e[j][k], 1, &square[i][j]);
    }
  }
  for (int m = 0; m < 10; ++m) {
    const double half_trace = 0.5 * (square[0][0][m] + square[1][1][m] + square[2][2][m]);
    for (int i = 0; i < 3; ++i) square[i][i][m] -= half_trace;
  }
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      Cubic& row = (*constraints)[3 * i + j];
      row = {};
      for (int k = 0; k < 3; ++k) add_product(square[std::min(i, k)][std::max(i, k)], e[k][j], &row);
    }
  }
  Cubic& determinant = (*constraints)[9];
  determinant = {};
  for (int j = 0; j < 3; ++j) {
    const int k = (j + 1) % 3, l = (j + 2) % 3;
    Quadratic minor = {};
    add_product(e[1][k], e[2][l], 1, &minor);
    add_product(e[1][l], e[2][k], -1, &minor);
    add_product(minor, e[0][j], &determinant);
  }
}

// Gauss-Jordan elimination with row pivots of the first ten columns. Only rows 4 to 9 are reduced fully: the
// rest is not used. Returns the smallest pivot, 0 when the system is singular.
double eliminate(Cubics* rows) {
  Cubics& a = *rows;
  double smallest = 1;
  for (int k = 0; k < 10; ++k) {
    int pivot = k;
    for (int i = k + 1; i < 10; ++i) {
      if (std::abs(a[i][k]) > std::abs(a[pivot][k])) pivot = i;
    }
    smallest = std::min(smallest, std::abs(a[pivot][k]));
    if (!(smallest > 1e-14)) return 0;
    if (pivot != k) std::swap(a[pivot], a[k]);
    const double inverse = 1.0 / a[k][k];
    for (int i = k + 1; i < 10; ++i) {
      const double factor = a[i][k] * inverse;
      for (int j = k + 1; j < 20; ++j) a[i][j] -= factor * a[k][j];
    }
  }
  for (int k = 9; k >= 4; --k) {
    const double inverse = 1.0 / a[k][k];
    for (int j = 10; j < 20; ++j) {
      double value = a[k][j];
      for (int i = k + 1; i < 10; ++i) value -= a[k][i] * a[i][j];
      a[k][j] = value * inverse;
    }
  }
  return smallest;
}

// Row of the 3x3 matrix B(z) with B(z) (x, y, 1)^T = 0, from upper - z * lower of two eliminated rows.
struct PolynomialRow {
  std::array<double, 4> x, y;  // coefficients of 1, z, z^2, z^3
  std::array<double, 5> one;   // and z^4
};

PolynomialRow subtract_shifted(const Cubic& upper, const Cubic& lower) {
  return {{upper[12], upper[11] - lower[12], upper[10] - lower[11], -lower[10]},
          {upper[15], upper[14] - lower[15], upper[13] - lower[14], -lower[13]},
          {upper[19], upper[18] - lower[19], upper[17] - lower[18], upper[16] - lower[17], -lower[16]}};
}

using PolynomialMatrix = std::array<PolynomialRow, 3>;

// det B(z), degree 10.
std::array<double, 11> determinant(const PolynomialMatrix& b) {
  std::array<double, 11> result = {};
  for (int r = 0; r < 3; ++r) {
    const PolynomialRow &p = b[(r + 1) % 3], &q = b[(r + 2) % 3];
    std::array<double, 7> minor = {};
    for (int i = 0; i < 4; ++i) {
      for (int j = 0; j < 4; ++j) minor[i + j] += p.x[i] * q.y[j] - q.x[i] * p.y[j];
    }
    for (int i = 0; i < 5; ++i) {
      for (int j = 0; j < 7; ++j) result[i + j] += b[r].one[i] * minor[j];
    }
  }
  return result;
}

template <size_t N>
double horner(const std::array<double, N>& c, double z) {
  double value = c[N - 1];
  for (int i = static_cast<int>(N) - 2; i >= 0; --i) value = value * z + c[i];
  return value;
}

// (x, y) of a root z: the null vector of B(z) as the largest cross product of two of its rows.
bool solve_xy(const PolynomialMatrix& b, double z, double* x, double* y) {
  Vector3d rows[3];
  for (int r = 0; r < 3; ++r) rows[r] = {horner(b[r].x, z), horner(b[r].y, z), horner(b[r].one, z)};
  Vector3d best = rows[0].cross(rows[1]);
  for (const Vector3d& cross : {rows[0].cross(rows[2]), rows[1].cross(rows[2])}) {
    if (std::abs(cross.z()) > std::abs(best.z())) best = cross;
  }
  if (!(std::abs(best.z()) > 0)) return false;
  *x = best.x() / best.z();
  *y = best.y() / best.z();
  return true;
}

// Residual of the trace constraint; `square` is E E^T - trace / 2.
Matrix3d constraint_residual(const Matrix3d& e, Matrix3d* square) {
  square->noalias() = e * e.transpose();
  square->diagonal().array() -= 0.5 * square->trace();
  return *square * e;
}

// Gauss-Newton on the nine equations of the trace constraint over the three directions of the basis that
// are orthogonal to E: the polynomial of degree ten has lost digits that the constraints still hold. E has
// norm one on entry and on exit.
void polish(const Basis& basis, Eigen::Vector4d c, Matrix3d* essential) {
  Matrix3d& e = *essential;
  Matrix3d square;
  for (int iteration = 0; iteration < 3; ++iteration) {
    const Matrix3d residual = constraint_residual(e, &square);
    if (residual.squaredNorm() < 1e-29) return;
    Eigen::Matrix<double, 9, 4> jacobian;
    for (int b = 0; b < 4; ++b) {
      const Matrix3d half = basis[b] * e.transpose();
      Matrix3d change = half + half.transpose();
      change.diagonal().array() -= half.trace();
      jacobian.col(b) = (change * e + square * basis[b]).reshaped();
    }
    // The component along E itself is held by a unit weight.
    Eigen::Matrix4d normal = jacobian.transpose() * jacobian + c * c.transpose();
    const Eigen::Vector4d step = normal.llt().solve(jacobian.transpose() * residual.reshaped());
    if (!(step.squaredNorm() < 0.01)) return;
    c = (c - step).normalized();
    e = c[0] * basis[0] + c[1] * basis[1] + c[2] * basis[2] + c[3] * basis[3];
  }
}

// Solutions in one basis of the null space, of Frobenius norm one. Sets `*sure` when the elimination and the
// polynomial were well conditioned, so that none is missing.
int solve_in_basis(const Basis& basis, std::array<Matrix3d, 10>* essentials, bool* sure) {
  constexpr double kSafePivot = 1e-3, kSafePolynomial = 1e-4;
  *sure = false;
  Cubics rows;
  essential_constraints(basis, &rows);
  const double pivot = eliminate(&rows);
  if (!(pivot > 0)) return 0;
  const PolynomialMatrix b = {subtract_shifted(rows[4], rows[5]), subtract_shifted(rows[6], rows[7]),
                              subtract_shifted(rows[8], rows[9])};
  std::array<double, 10> roots;
  double conditioning;
  const int count = real_roots(determinant(b), roots.data(), &conditioning);
  // Complex roots come in pairs: an odd count is a lost root.
  *sure = pivot > kSafePivot && conditioning > kSafePolynomial && count % 2 == 0;

  int found = 0;
  for (int i = 0; i < count; ++i) {
    double x, y;
    const double z = roots[i];
    if (!solve_xy(b, z, &x, &y)) continue;
    const Eigen::Vector4d c = Eigen::Vector4d(x, y, z, 1).normalized();
    Matrix3d e = c[0] * basis[0] + c[1] * basis[1] + c[2] * basis[2] + c[3] * basis[3];
    if (!e.allFinite()) continue;
    polish(basis, c, &e);
    (*essentials)[found++] = e;
  }
  return found;
}

// The same null space, its basis turned by a fixed rotation of four dimensions.
Basis turned(const Basis& basis) {
  constexpr double a = 0.5, b = 0.1, c = 0.7, d = 0.5;  // a unit quaternion
  return {a * basis[0] - b * basis[1] - c * basis[2] - d * basis[3],
          b * basis[0] + a * basis[1] - d * basis[2] + c * basis[3],
          c * basis[0] + d * basis[1] + a * basis[2] - b * basis[3],
          d * basis[0] - c * basis[1] + b * basis[2] + a * basis[3]};
}

// Adds the matrices that are not yet in the list, up to sign; of two that are the same the more exact one
// stays.
int merge(const std::array<Matrix3d, 10>& more, int more_count, std::array<Matrix3d, 10>* list, int count) {
  constexpr double kSame = 1e-6;
  Matrix3d square;
  for (int i = 0; i < more_count; ++i) {
    const auto same = std::find_if(list->begin(), list->begin() + count, [&](const Matrix3d& e) {
      return std::min((e - more[i]).norm(), (e + more[i]).norm()) < kSame;
    });
    if (same == list->begin() + count) {
      if (count < 10) (*list)[count++] = more[i];
    } else if (constraint_residual(more[i], &square).norm() < constraint_residual(*same, &square).norm()) {
      *same = more[i];
    }
  }
  return count;
}

}  // namespace

int five_point(std::span<const Vector3d, 5> bearings0, std::span<const Vector3d, 5> bearings1,
               std::array<Matrix3d, 10>* essentials) {
  Basis basis;
  if (!null_space(bearings0, bearings1, &basis)) return 0;
  bool sure;
  int count = solve_in_basis(basis, essentials, &sure);
  // One sample in ten is unsure. Other unknowns have another polynomial, whose roots lie apart.
  constexpr int kMaxTurns = 2;
  for (int turn = 0; !sure && turn < kMaxTurns; ++turn) {
    const std::array<Matrix3d, 10> known = *essentials;
    basis = turned(basis);
    count = merge(known, count, essentials, solve_in_basis(basis, essentials, &sure));
  }
  for (int i = 0; i < count; ++i) (*essentials)[i] *= std::sqrt(2.0);
  return count;
}

}  // namespace raysfm
