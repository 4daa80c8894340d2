#include "raysfm/robust/rotation_ransac.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>

namespace raysfm {

using Eigen::Matrix3d;
using Eigen::Vector3d;

namespace {

// The rotation nearest to the sum of the products b2 b0^T (Wahba's problem).
void kabsch(const Matrix3d& sum, Matrix3d* rotation) {
  const Eigen::JacobiSVD<Matrix3d> svd(sum, Eigen::ComputeFullU | Eigen::ComputeFullV);
  if (!(svd.singularValues()[1] > 1e-12)) return;
  Vector3d signs(1, 1, 1);
  signs[2] = (svd.matrixU() * svd.matrixV().transpose()).determinant() < 0 ? -1 : 1;
  *rotation = svd.matrixU() * signs.asDiagonal() * svd.matrixV().transpose();
}

}  // namespace

// Sum and difference of two unit vectors are orthogonal: aligning them is the best rotation of the two.
int RotationRansac::generate(const std::array<int, 2>& sample, std::array<Matrix3d, 1>* models) const {
  std::array<Matrix3d, 2> frames;
  for (int v = 0; v < 2; ++v) {
    const std::span<const Vector3d> bearings = v == 0 ? bearings0_ : bearings2_;
    const Vector3d sum = bearings[sample[0]] + bearings[sample[1]];
    const Vector3d difference = bearings[sample[0]] - bearings[sample[1]];
    if (!(sum.squaredNorm() > 1e-12 && difference.squaredNorm() > 1e-12)) return 0;
    frames[v].col(0) = sum.normalized();
    frames[v].col(1) = difference.normalized();
    frames[v].col(2) = frames[v].col(0).cross(frames[v].col(1));
  }
  (*models)[0] = frames[1] * frames[0].transpose();
  return 1;
}

RansacScore RotationRansac::score(const Matrix3d& rotation, double limit) const {
  return truncated_score(size(), limit, [&](int i) {
    return (rotation * bearings0_[i] - bearings2_[i]).squaredNorm() / max_error2_;
  });
}

void RotationRansac::refine(Matrix3d* rotation) const {
  Matrix3d sum = Matrix3d::Zero();
  for (int i = 0; i < size(); ++i) {
    if ((*rotation * bearings0_[i] - bearings2_[i]).squaredNorm() >= max_error2_) continue;
    sum += bearings2_[i] * bearings0_[i].transpose();
  }
  kabsch(sum, rotation);
}

int rotation_inliers(std::span<const Vector3d> bearings0, std::span<const Vector3d> bearings2,
                     double max_error, double least, RansacOptions options) {
  RotationRansac rotations(bearings0, bearings2, max_error);
  const double needed = ransac_iterations_needed(std::min(1.0, least / rotations.size()),
                                                 RotationRansac::kSampleSize, options.confidence);
  options.max_iterations = std::max(
      options.min_iterations, static_cast<int>(std::min(std::ceil(needed), 1.0 * options.max_iterations)));
  Matrix3d rotation = Matrix3d::Identity();
  return ransac(rotations, options, &rotation).score.inliers;
}

}  // namespace raysfm
