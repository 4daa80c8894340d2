#include "raysfm/projective/projective_resection.h"

#include <Eigen/Eigenvalues>
#include <cmath>

namespace raysfm {

bool view_from_points(std::span<const Eigen::Vector4d> points, std::span<const Eigen::Vector2d> pixels,
                      Matrix34d* view) {
  constexpr double kSmall = 1e-14;
  using Matrix12d = Eigen::Matrix<double, 12, 12>;
  if (points.size() < 6 || points.size() != pixels.size()) return false;
  // In a projective frame the points may be spread badly: whitened by their second moments.
  Eigen::Matrix4d moments = Eigen::Matrix4d::Zero();
  for (const Eigen::Vector4d& x : points) moments.noalias() += x * x.transpose() / x.squaredNorm();
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix4d> spread(moments);
  if (!(spread.eigenvalues()[0] > kSmall * spread.eigenvalues()[3])) return false;
  const Eigen::Matrix4d whitening =
      spread.eigenvalues().cwiseSqrt().cwiseInverse().asDiagonal() * spread.eigenvectors().transpose();
  Matrix12d normal = Matrix12d::Zero();
  for (size_t i = 0; i < points.size(); ++i) {
    const Eigen::Vector4d x = (whitening * points[i]).normalized();
    for (int axis = 0; axis < 2; ++axis) {
      Eigen::Matrix<double, 12, 1> row = Eigen::Matrix<double, 12, 1>::Zero();  // P by rows
      row.segment<4>(4 * axis) = x;
      row.tail<4>() = -pixels[i][axis] * x;
      normal.noalias() += row * row.transpose();
    }
  }
  const Eigen::SelfAdjointEigenSolver<Matrix12d> eigen(normal);
  if (!(eigen.eigenvalues()[1] > kSmall * eigen.eigenvalues()[11])) return false;
  const Eigen::Matrix<double, 12, 1> p = eigen.eigenvectors().col(0);
  const Eigen::Matrix<double, 4, 3> rows = Eigen::Map<const Eigen::Matrix<double, 4, 3>>(p.data());
  *view = (rows.transpose() * whitening).normalized();
  return view->allFinite();
}

}  // namespace raysfm
