#include "raysfm/solvers/seventeen_point.h"

#include <Eigen/Cholesky>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <utility>

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

}  // namespace

PlessRow pless_row(const Ray& ray0, const Ray& ray1) {
  const PluckerLine line0 = plucker_line(ray0), line1 = plucker_line(ray1);
  PlessRow row;
  for (int j = 0; j < 3; ++j) {
    for (int i = 0; i < 3; ++i) {
      row[3 * j + i] = line0.moment[i] * line1.direction[j] + line0.direction[i] * line1.moment[j];
      row[9 + 3 * j + i] = -line0.direction[i] * line1.direction[j];
    }
  }
  return row;
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
  const auto centred = [&](const Ray& ray) {
    return Ray{(ray.origin - ray_class.centre) / unit, ray.direction};
  };
  std::array<Matrix3d, 9> storage;
  const std::span<const Matrix3d> parts(storage.data(), exact_rotation_parts(ray_class, &storage));
  Matrix18d normal = Matrix18d::Zero();
  for (size_t i = 0; i < rays0.size(); ++i) {
    const PlessRow row = pless_row(centred(rays0[i]), centred(rays1[i]));
    normal.selfadjointView<Eigen::Lower>().rankUpdate(row.transpose());
  }
  normal.triangularView<Eigen::StrictlyUpper>() = normal.transpose();
  if (!normal.allFinite()) return 0;
  const Basis18 basis = complement(parts);
  const Vector18d x = basis * least_vector(basis.transpose() * normal * basis);

  // The exact solutions change R~ alone in this frame, so that E~ is known as it is.
  Matrix3d essential = Eigen::Map<const Matrix3d>(x.data() + 9);
  const double size = essential.norm();
  if (!(size > 1e-12)) return 0;
  essential *= std::sqrt(2.0) / size;
  const std::array<Rigid3, 4> candidates = decompose_essential(essential);
  std::array<std::pair<double, int>, 4> order;
  std::array<Rigid3, 4> poses;  // rig0_from_rig1 about the centre
  for (int k = 0; k < 4; ++k) {
    const Matrix3d rotation = candidates[k].rotation.toRotationMatrix();
    const Vector3d t = candidates[k].translation;
    double slope2 = 0, product = 0, constant2 = 0;
    for (size_t i = 0; i < rays0.size(); ++i) {
      const PluckerLine line0 = plucker_line(centred(rays0[i])), line1 = plucker_line(centred(rays1[i]));
      const double constant = pless_residual(rotation, Vector3d::Zero(), line0, line1);
      const double slope = -line0.direction.dot(t.cross(rotation * line1.direction));
      slope2 += slope * slope, product += slope * constant, constant2 += constant * constant;
    }
    const double scale = central ? 1 : -product / slope2;
    poses[k] = {candidates[k].rotation, scale * t};
    // Decompositions with t and -t are the same pose once the scale is free: the positive one stays.
    order[k] = {constant2 + scale * (2 * product + scale * slope2), k};
    if (!(scale >= 0) || !std::isfinite(scale)) order[k].first = std::numeric_limits<double>::infinity();
  }
  std::sort(order.begin(), order.end());
  int count = 0;
  for (const auto& [cost, k] : order) {
    if (!std::isfinite(cost)) continue;
    Rigid3 rig0_from_rig1 = poses[k];
    const Vector3d& c = ray_class.centre;
    rig0_from_rig1.translation = unit * rig0_from_rig1.translation + c - rig0_from_rig1.rotation * c;
    (*rig1_from_rig0)[count++] = rig0_from_rig1.inverse();
  }
  return count;
}

}  // namespace raysfm
