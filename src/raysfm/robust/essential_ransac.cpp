#include "raysfm/robust/essential_ransac.h"

#include <Eigen/Eigenvalues>
#include <Eigen/SVD>

#include "raysfm/solvers/five_point.h"

namespace raysfm {

int EssentialRansac::generate(const std::array<int, kSampleSize>& sample,
                              std::array<Eigen::Matrix3d, kMaxModels>* models) const {
  std::array<Eigen::Vector3d, kSampleSize> in_0, in_1;
  for (int i = 0; i < kSampleSize; ++i) in_0[i] = bearings0_[sample[i]], in_1[i] = bearings1_[sample[i]];
  return five_point(in_0, in_1, models);
}

double EssentialRansac::share2(const Eigen::Matrix3d& essential, int match) const {
  const Eigen::Vector3d &a = bearings0_[match], &b = bearings1_[match];
  const Eigen::Vector3d normal1 = essential * a, normal0 = essential.transpose() * b;
  const double product = b.dot(normal1);
  // A bearing moves on the sphere, along which the product changes by what of the normal is across it.
  const double slope2 = normal0.squaredNorm() + normal1.squaredNorm() - 2 * product * product;
  return product * product / (slope2 * max_error2_);
}

RansacScore EssentialRansac::score(const Eigen::Matrix3d& essential, double limit) const {
  return truncated_score(size(), limit, [&](int i) { return share2(essential, i); });
}

void EssentialRansac::refine(Eigen::Matrix3d* essential) const {
  constexpr int kEnough = 16;
  using Row = Eigen::Matrix<double, 9, 1>;
  Eigen::Matrix<double, 9, 9> normal = Eigen::Matrix<double, 9, 9>::Zero();
  int inliers = 0;
  for (int i = 0; i < size(); ++i) {
    if (!is_inlier(*essential, i)) continue;
    const Eigen::Matrix3d product = bearings1_[i] * bearings0_[i].transpose();
    const Row row = Eigen::Map<const Row>(product.data());
    const double slope2 =
        (*essential * bearings0_[i]).squaredNorm() + (essential->transpose() * bearings1_[i]).squaredNorm();
    normal.noalias() += row * row.transpose() / slope2;
    ++inliers;
  }
  if (inliers < kEnough) return;
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix<double, 9, 9>> eigen(normal);
  const Row least = eigen.eigenvectors().col(0);
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(Eigen::Map<const Eigen::Matrix3d>(least.data()),
                                              Eigen::ComputeFullU | Eigen::ComputeFullV);
  *essential = svd.matrixU() * Eigen::Vector3d(1, 1, 0).asDiagonal() * svd.matrixV().transpose();
}

}  // namespace raysfm
