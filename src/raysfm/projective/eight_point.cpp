#include "raysfm/projective/eight_point.h"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <Eigen/SVD>
#include <cmath>
#include <numbers>

namespace raysfm {
namespace {

using Matrix9d = Eigen::Matrix<double, 9, 9>;
using Vector9d = Eigen::Matrix<double, 9, 1>;

// Least eigenvector of A^T A; false when the second is as small.
bool null_vector(const Matrix9d& normal, Vector9d* vector) {
  constexpr double kSmall = 1e-13;
  const Eigen::SelfAdjointEigenSolver<Matrix9d> eigen(normal);
  *vector = eigen.eigenvectors().col(0);
  return vector->allFinite() && eigen.eigenvalues()[1] > kSmall * eigen.eigenvalues()[8];
}

Eigen::Vector2d apply(const Eigen::Matrix3d& similarity, const Eigen::Vector2d& p) {
  return similarity(0, 0) * p + similarity.topRightCorner<2, 1>();
}

}  // namespace

Eigen::Matrix3d normalising_similarity(std::span<const Eigen::Vector2d> points) {
  Eigen::Vector2d mean = Eigen::Vector2d::Zero();
  for (const Eigen::Vector2d& p : points) mean += p;
  mean /= static_cast<double>(points.size());
  double distance = 0;
  for (const Eigen::Vector2d& p : points) distance += (p - mean).norm();
  distance /= static_cast<double>(points.size());
  const double scale = distance > 0 ? std::numbers::sqrt2 / distance : 1;
  Eigen::Matrix3d similarity = Eigen::Matrix3d::Identity();
  similarity.topLeftCorner<2, 2>() *= scale;
  similarity.topRightCorner<2, 1>() = -scale * mean;
  return similarity;
}

bool fundamental_from_points(std::span<const Eigen::Vector2d> a, std::span<const Eigen::Vector2d> b,
                             Eigen::Matrix3d* fundamental) {
  if (a.size() < 8 || a.size() != b.size()) return false;
  const Eigen::Matrix3d of_a = normalising_similarity(a), of_b = normalising_similarity(b);
  Matrix9d normal = Matrix9d::Zero();
  for (size_t i = 0; i < a.size(); ++i) {
    const Eigen::Vector3d x = apply(of_a, a[i]).homogeneous(), y = apply(of_b, b[i]).homogeneous();
    Vector9d row;  // F by columns
    for (int c = 0; c < 3; ++c) row.segment<3>(3 * c) = x[c] * y;
    normal.noalias() += row * row.transpose();
  }
  Vector9d f;
  if (!null_vector(normal, &f)) return false;
  Eigen::JacobiSVD<Eigen::Matrix3d> svd(Eigen::Map<const Eigen::Matrix3d>(f.data()),
                                        Eigen::ComputeFullU | Eigen::ComputeFullV);
  const Eigen::Vector3d values(svd.singularValues()[0], svd.singularValues()[1], 0);
  const Eigen::Matrix3d rank2 = svd.matrixU() * values.asDiagonal() * svd.matrixV().transpose();
  *fundamental = (of_b.transpose() * rank2 * of_a).normalized();
  return fundamental->allFinite();
}

bool homography_from_points(std::span<const Eigen::Vector2d> a, std::span<const Eigen::Vector2d> b,
                            Eigen::Matrix3d* homography) {
  if (a.size() < 4 || a.size() != b.size()) return false;
  const Eigen::Matrix3d of_a = normalising_similarity(a), of_b = normalising_similarity(b);
  Matrix9d normal = Matrix9d::Zero();
  for (size_t i = 0; i < a.size(); ++i) {
    const Eigen::Vector3d x = apply(of_a, a[i]).homogeneous();
    const Eigen::Vector2d y = apply(of_b, b[i]);
    for (int axis = 0; axis < 2; ++axis) {
      Vector9d row = Vector9d::Zero();  // H by rows
      row.segment<3>(3 * axis) = x;
      row.tail<3>() = -y[axis] * x;
      normal.noalias() += row * row.transpose();
    }
  }
  Vector9d h;
  if (!null_vector(normal, &h)) return false;
  const Eigen::Matrix3d normalised = Eigen::Map<const Eigen::Matrix3d>(h.data()).transpose();
  *homography = (of_b.inverse() * normalised * of_a).normalized();
  return homography->allFinite();
}

double sampson_error2(const Eigen::Matrix3d& fundamental, const Eigen::Vector2d& a,
                      const Eigen::Vector2d& b) {
  const Eigen::Vector3d in_b = fundamental * a.homogeneous(),
                        in_a = fundamental.transpose() * b.homogeneous();
  const double distance = b.homogeneous().dot(in_b);
  return distance * distance / (in_b.head<2>().squaredNorm() + in_a.head<2>().squaredNorm());
}

}  // namespace raysfm
