#include "raysfm/solvers/seventeen_point.h"

#include <Eigen/Cholesky>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <vector>

#include "raysfm/geometry/plucker.h"
#include "raysfm/geometry/rotation.h"
#include "raysfm/solvers/five_point.h"

namespace raysfm {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using Vector18d = Eigen::Matrix<double, 18, 1>;
using Matrix18d = Eigen::Matrix<double, 18, 18>;
using Basis18 = Eigen::Matrix<double, 18, Eigen::Dynamic, 0, 18, 18>;

// The matrices R~ of the exact solutions, the origin in the centre; E~ is zero then, for it is
// [c]x R~ - R~ [c]x with a centre c of the camera.
int exact_rotation_parts(const RayClass& c, std::array<Matrix3d, 9>* parts) {
  const Vector3d& a = c.axis;
  switch (c.centres) {
    case CentreClass::kCentral:
      for (int i = 0; i < 9; ++i) (*parts)[i] = Matrix3d::Zero(), (*parts)[i].data()[i] = 1;
      return 9;
    case CentreClass::kAxial:
      (*parts)[0] = a * a.transpose();
      if (!c.simple) return 1;
      (*parts)[1] = (Matrix3d::Identity() - a * a.transpose()) / std::sqrt(2.0);
      (*parts)[2] = skew(a) / std::sqrt(2.0);
      return 3;
    case CentreClass::kNonAxial:
      if (!c.simple) return 0;
      (*parts)[0] = Matrix3d::Identity() / std::sqrt(3.0);
      return 1;
  }
  return 0;
}

// Orthonormal basis of the vectors orthogonal to the exact solutions of a central, axial or non-axial camera
// in its centre's frame.
Basis18 complement(std::span<const Matrix3d> parts) {
  const int exact = static_cast<int>(parts.size());
  Eigen::Matrix<double, 9, Eigen::Dynamic, 0, 9, 9> columns(9, std::max(exact, 1));
  columns.setZero();
  for (int i = 0; i < exact; ++i)
    columns.col(i) = Eigen::Map<const Eigen::Matrix<double, 9, 1>>(parts[i].data());
  Basis18 basis = Basis18::Zero(18, 18 - exact);
  if (exact == 0) return basis.setIdentity(), basis;
  const Eigen::HouseholderQR<Eigen::Matrix<double, 9, Eigen::Dynamic, 0, 9, 9>> qr(columns);
  const Eigen::Matrix<double, 9, 9> q = qr.householderQ();
  basis.topLeftCorner(9, 9 - exact) = q.rightCols(9 - exact);
  basis.bottomRightCorner<9, 9>().setIdentity();
  return basis;
}

// The unit vector of least |B z|, by inverse iteration on B^T B.
Eigen::VectorXd least_vector(const Eigen::Ref<const Eigen::MatrixXd>& normal) {
  constexpr int kIterations = 30;
  const int n = static_cast<int>(normal.rows());
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, 18, 18> shifted = normal;
  shifted.diagonal().array() += 1e-15 * normal.trace();
  const Eigen::LDLT<Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, 18, 18>> factor(shifted);
  Eigen::Matrix<double, Eigen::Dynamic, 1, 0, 18, 1> z(n), next(n);
  for (int i = 0; i < n; ++i) z[i] = 1 + 0.1 * ((7 * i) % 5);  // no reason to be orthogonal to it
  z.normalize();
  for (int k = 0; k < kIterations; ++k) {
    next = factor.solve(z);
    const double norm = next.norm();
    if (!(norm > 0 && std::isfinite(norm))) break;
    next /= norm;
    const double change = 1 - std::abs(next.dot(z));
    z = next;
    if (change < 1e-15) break;
  }
  return z;
}

// Rays about the centre of the camera in units of its size, as lines.
struct CentredLines {
  std::vector<PluckerLine> lines0, lines1;
  CentredLines(std::span<const Ray> rays0, std::span<const Ray> rays1, const Vector3d& centre, double unit) {
    const auto centred = [&](const Ray& ray) {
      return plucker_line(Ray{(ray.origin - centre) / unit, ray.direction});
    };
    std::transform(rays0.begin(), rays0.end(), std::back_inserter(lines0), centred);
    std::transform(rays1.begin(), rays1.end(), std::back_inserter(lines1), centred);
  }
  size_t size() const { return lines0.size(); }
};

PlessRow pless_row(const PluckerLine& line0, const PluckerLine& line1) {
  PlessRow row;
  for (int j = 0; j < 3; ++j) {
    for (int i = 0; i < 3; ++i) {
      row[3 * j + i] = line0.moment[i] * line1.direction[j] + line0.direction[i] * line1.moment[j];
      row[9 + 3 * j + i] = -line0.direction[i] * line1.direction[j];
    }
  }
  return row;
}

// E~ of norm sqrt(2) from the part of the kernel that is orthogonal to the exact solutions: these change R~
// alone in this frame. False where the matches do not determine it.
bool find_essential(const CentredLines& lines, const RayClass& ray_class, Matrix3d* essential) {
  constexpr double kLeastSize = 1e-12;
  Matrix18d normal = Matrix18d::Zero();
  for (size_t i = 0; i < lines.size(); ++i) {
    const PlessRow row = pless_row(lines.lines0[i], lines.lines1[i]);
    normal.selfadjointView<Eigen::Lower>().rankUpdate(row.transpose());
  }
  normal.triangularView<Eigen::StrictlyUpper>() = normal.transpose();
  if (!normal.allFinite()) return false;
  std::array<Matrix3d, 9> parts;
  const int exact = exact_rotation_parts(ray_class, &parts);
  const Basis18 basis = complement(std::span(parts.data(), exact));
  const Vector18d x = basis * least_vector(basis.transpose() * normal * basis);
  *essential = Eigen::Map<const Matrix3d>(x.data() + 9);
  const double size = essential->norm();
  if (!(size > kLeastSize)) return false;
  *essential *= std::sqrt(2.0) / size;
  return true;
}

// A pose rig0_from_rig1 about the centre, and the sum of its squared Pless residuals.
struct Candidate {
  double cost;
  Rigid3 pose;
};

// The residual of a match is linear in the length of the translation: constant + slope * length. Takes the
// length that fits the matches best, or 1 for a central camera, of which they tell none. Decompositions with
// t and -t are the same pose once the length is free: a negative one has an infinite cost.
Candidate scaled(const Rigid3& direction, const CentredLines& lines, bool central) {
  const Matrix3d rotation = direction.rotation.toRotationMatrix();
  const Vector3d t = direction.translation;
  double slope2 = 0, product = 0, constant2 = 0;
  for (size_t i = 0; i < lines.size(); ++i) {
    const PluckerLine &line0 = lines.lines0[i], &line1 = lines.lines1[i];
    const double constant = pless_residual(rotation, Vector3d::Zero(), line0, line1);
    const double slope = -line0.direction.dot(t.cross(rotation * line1.direction));
    slope2 += slope * slope, product += slope * constant, constant2 += constant * constant;
  }
  const double length = central ? 1 : -product / slope2;
  Candidate candidate{constant2 + length * (2 * product + length * slope2), {direction.rotation, length * t}};
  if (!(length >= 0) || !std::isfinite(length)) candidate.cost = std::numeric_limits<double>::infinity();
  return candidate;
}

}  // namespace

PlessRow pless_row(const Ray& ray0, const Ray& ray1) {
  return pless_row(plucker_line(ray0), plucker_line(ray1));
}

Eigen::Matrix<double, 18, Eigen::Dynamic> exact_pless_solutions(const RayClass& ray_class) {
  std::array<Matrix3d, 9> parts;
  const int count = exact_rotation_parts(ray_class, &parts);
  Eigen::Matrix<double, 18, Eigen::Dynamic> solutions(18, count);
  const Matrix3d c = skew(ray_class.centre);
  for (int i = 0; i < count; ++i) {
    const Matrix3d essential = c * parts[i] - parts[i] * c;
    solutions.col(i).head<9>() = Eigen::Map<const Eigen::Matrix<double, 9, 1>>(parts[i].data());
    solutions.col(i).tail<9>() = Eigen::Map<const Eigen::Matrix<double, 9, 1>>(essential.data());
  }
  if (count == 0) return solutions;
  const Eigen::HouseholderQR<Eigen::MatrixXd> qr(solutions);
  return Eigen::MatrixXd(qr.householderQ()).leftCols(count);
}

int seventeen_point(std::span<const Ray> rays0, std::span<const Ray> rays1, const RayClass& ray_class,
                    std::array<Rigid3, 4>* rig1_from_rig0) {
  if (rays0.size() < 17 || rays0.size() != rays1.size()) return 0;
  const bool central = ray_class.centres == CentreClass::kCentral;
  const double unit = central ? 1 : ray_class.spread;
  const CentredLines lines(rays0, rays1, ray_class.centre, unit);
  Matrix3d essential;
  if (!find_essential(lines, ray_class, &essential)) return 0;
  std::array<Candidate, 4> candidates;
  const std::array<Rigid3, 4> directions = decompose_essential(essential);
  for (int k = 0; k < 4; ++k) candidates[k] = scaled(directions[k], lines, central);
  std::stable_sort(candidates.begin(), candidates.end(),
                   [](const Candidate& a, const Candidate& b) { return a.cost < b.cost; });
  int count = 0;
  for (const Candidate& candidate : candidates) {
    if (!std::isfinite(candidate.cost)) continue;
    Rigid3 rig0_from_rig1 = candidate.pose;
    const Vector3d& c = ray_class.centre;
    rig0_from_rig1.translation = unit * rig0_from_rig1.translation + c - rig0_from_rig1.rotation * c;
    (*rig1_from_rig0)[count++] = rig0_from_rig1.inverse();
  }
  return count;
}

}  // namespace raysfm
