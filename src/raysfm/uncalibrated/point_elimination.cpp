#include "raysfm/uncalibrated/point_elimination.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cassert>

namespace raysfm {
namespace {

// target (B x B, by columns, `stride` apart) -= Z_row Z_column^T.
template <int B>
void subtract_product(const double* z_row, const double* z_column, double* target, int stride) {
  for (int c = 0; c < B; ++c, target += stride) {
    const double z0 = z_column[c], z1 = z_column[B + c], z2 = z_column[2 * B + c];
    for (int r = 0; r < B; ++r) target[r] -= z_row[r] * z0 + z_row[B + r] * z1 + z_row[2 * B + r] * z2;
  }
}

}  // namespace

void PointElimination::set_structure(int images, int block, int shared, std::span<const int> point_begin,
                                     std::span<const int> image_of_slot) {
  constexpr Kernel kKernels[] = {subtract_product<6>, subtract_product<7>,  subtract_product<8>,
                                 subtract_product<9>, subtract_product<10>, subtract_product<11>,
                                 subtract_product<12>};
  assert(block >= 6 && block <= kMaxBlock);
  images_ = images;
  block_ = block;
  shared_ = shared;
  kernel_ = kKernels[block - 6];
  point_begin_.assign(point_begin.begin(), point_begin.end());
  image_of_slot_.assign(image_of_slot.begin(), image_of_slot.end());
  w_.resize(size_t(3) * block * image_of_slot.size());
  z_.resize(w_.size());
  shared_w_.resize(size_t(3) * shared * points());
  shared_z_.resize(shared_w_.size());
  v_.resize(points());
  inverse_factor_.resize(points());
  point_gradient_.resize(points());
  y_.resize(points());
  point_steps_.resize(points());
  u_.resize(rows(), rows());
  reduced_.resize(rows(), rows());
  gradient_.resize(rows());
  right_.resize(rows());
}

void PointElimination::set_zero() {
  u_.setZero();
  gradient_.setZero();
  std::fill(w_.begin(), w_.end(), 0.0);
  std::fill(shared_w_.begin(), shared_w_.end(), 0.0);
  std::fill(v_.begin(), v_.end(), Eigen::Matrix3d::Zero());
  std::fill(point_gradient_.begin(), point_gradient_.end(), Eigen::Vector3d::Zero());
}

bool PointElimination::factorize(int point, double damping) {
  Eigen::Matrix3d damped = v_[point];
  for (int k = 0; k < 3; ++k) damped(k, k) *= 1 + damping;
  const Eigen::LLT<Eigen::Matrix3d> llt(damped);
  if (llt.info() != Eigen::Success) return false;
  inverse_factor_[point] = llt.matrixL().solve(Eigen::Matrix3d::Identity());
  y_[point] = inverse_factor_[point] * point_gradient_[point];
  return true;
}

void PointElimination::scale_slots(int point) {
  const Eigen::Matrix3d& inverse = inverse_factor_[point];
  const Eigen::Vector3d& y = y_[point];
  for (int slot = point_begin_[point]; slot < point_begin_[point + 1]; ++slot) {
    const double* w = &w_[size_t(3) * block_ * slot];
    double* z = &z_[size_t(3) * block_ * slot];
    double* right = &right_[size_t(block_) * image_of_slot_[slot]];
    for (int r = 0; r < block_; ++r) {
      const double w0 = w[r], w1 = w[block_ + r], w2 = w[2 * block_ + r];
      const double z0 = w0 * inverse(0, 0);
      const double z1 = w0 * inverse(1, 0) + w1 * inverse(1, 1);
      const double z2 = w0 * inverse(2, 0) + w1 * inverse(2, 1) + w2 * inverse(2, 2);
      z[r] = z0, z[block_ + r] = z1, z[2 * block_ + r] = z2;
      right[r] -= z0 * y[0] + z1 * y[1] + z2 * y[2];
    }
  }
}

void PointElimination::subtract_shared(int point) {
  const Cross w = shared_w(point);
  Cross z(&shared_z_[size_t(3) * shared_ * point], shared_, 3);
  z.noalias() = w.lazyProduct(inverse_factor_[point].transpose());
  const int first = images_ * block_;
  right_.tail(shared_).noalias() -= z.lazyProduct(y_[point]);
  reduced_.bottomRightCorner(shared_, shared_).noalias() -= z.lazyProduct(z.transpose());
  for (int slot = point_begin_[point]; slot < point_begin_[point + 1]; ++slot) {
    const Cross z_slot(&z_[size_t(3) * block_ * slot], block_, 3);
    reduced_.block(first, block_ * image_of_slot_[slot], shared_, block_).noalias() -=
        z.lazyProduct(z_slot.transpose());
  }
}

bool PointElimination::reduce(double damping) {
  reduced_ = u_;
  right_ = gradient_;
  const int stride = rows();
  for (int point = 0; point < points(); ++point) {
    if (!factorize(point, damping)) return false;
    scale_slots(point);
    const int begin = point_begin_[point], end = point_begin_[point + 1];
    for (int column = begin; column < end; ++column) {
      const double* z_column = &z_[size_t(3) * block_ * column];
      double* first = reduced_.data() + size_t(stride) * block_ * image_of_slot_[column];
      for (int row = column; row < end; ++row) {
        kernel_(&z_[size_t(3) * block_ * row], z_column, first + size_t(block_) * image_of_slot_[row],
                stride);
      }
    }
    if (shared_ > 0) subtract_shared(point);
  }
  return true;
}

void PointElimination::substitute(const Eigen::VectorXd& c) {
  for (int point = 0; point < points(); ++point) {
    Eigen::Vector3d sum = y_[point];
    for (int slot = point_begin_[point]; slot < point_begin_[point + 1]; ++slot) {
      const double* z = &z_[size_t(3) * block_ * slot];
      const double* numbers = c.data() + size_t(block_) * image_of_slot_[slot];
      for (int k = 0; k < 3; ++k, z += block_) {
        for (int r = 0; r < block_; ++r) sum[k] += z[r] * numbers[r];
      }
    }
    const double* z = shared_z_.data() + size_t(3) * shared_ * point;
    for (int k = 0; k < 3 * shared_; ++k) sum[k / shared_] += z[k] * c[images_ * block_ + k % shared_];
    point_steps_[point] = -(inverse_factor_[point].transpose() * sum);
  }
}

double PointElimination::gradient_along_step() const {
  double sum = 0;
  for (int point = 0; point < points(); ++point) sum += point_gradient_[point].dot(point_steps_[point]);
  return sum;
}

double PointElimination::scaled_step_norm() const {
  double sum = 0;
  for (int point = 0; point < points(); ++point) {
    sum += v_[point].diagonal().dot(point_steps_[point].cwiseAbs2());
  }
  return sum;
}

}  // namespace raysfm
