#include "raysfm/lenses/point_elimination.h"

#include <array>
#include <atomic>
#include <cassert>
#include <cmath>
#include <numeric>

#include "raysfm/optim/cholesky_kernels.h"

namespace raysfm {
namespace {

constexpr int kSlack = std::max(kKernelSlack, kEliminationSlack);

int block_number(int row, int column) {
  return row * (row + 1) / 2 + column;
}

}  // namespace

void PointElimination::set_structure(int images, int block, int shared, std::span<const int> point_begin,
                                     std::span<const int> image_of_slot) {
  assert(block >= 6 && block <= kMaxBlock && shared <= 8 && (shared == 0 || block <= 8));
  images_ = images;
  block_ = block;
  shared_ = shared;
  padded_ = padded_rows(block);
  point_begin_.assign(point_begin.begin(), point_begin.end());
  first_row_.resize(image_of_slot.size());
  for (int slot = 0; slot < slots(); ++slot) first_row_[slot] = block * image_of_slot[slot];
  place_slots(image_of_slot);
  w_.assign(offset(slots() + (shared > 0 ? points() : 0)), 0.0);
  set_size(z_, w_.size());
  v_.resize(points());
  inverse_factor_.resize(size_t(6) * points());
  point_gradient_.resize(points());
  y_.resize(points());
  point_steps_.resize(points());
  u_.resize(rows(), rows());
  gradient_.resize(rows());
  stride_ = rows() + kSlack;
  reduced_.assign(size_t(stride_) * rows() + kSlack, 0.0);
  right_.assign(rows() + kSlack, 0.0);
  numbers_.assign(rows() + kSlack, 0.0);
  list_pairs(image_of_slot);
}

void PointElimination::place_slots(std::span<const int> image_of_slot) {
  place_begin_.assign(images_ + 1, 0);
  for (const int image : image_of_slot) ++place_begin_[image + 1];
  std::partial_sum(place_begin_.begin(), place_begin_.end(), place_begin_.begin());
  std::vector<int> next = place_begin_;
  place_of_slot_.resize(slots());
  point_of_place_.resize(slots() + (shared_ > 0 ? points() : 0));
  for (int point = 0; point < points(); ++point) {
    for (int slot = point_begin_[point]; slot < point_begin_[point + 1]; ++slot) {
      place_of_slot_[slot] = next[image_of_slot[slot]]++;
      point_of_place_[place_of_slot_[slot]] = point;
    }
  }
  if (shared_ == 0) return;
  std::iota(point_of_place_.begin() + slots(), point_of_place_.end(), 0);
  place_begin_.push_back(slots() + points());
}

void PointElimination::list_pairs(std::span<const int> image_of_slot) {
  const auto each = [&](auto&& body) {
    for (int point = 0; point < points(); ++point) {
      const int begin = point_begin_[point], end = point_begin_[point + 1];
      for (int row = begin; row < end; ++row) {
        for (int column = begin; column <= row; ++column) {
          body(block_number(image_of_slot[row], image_of_slot[column]), place_of_slot_[row],
               place_of_slot_[column]);
        }
      }
      if (shared_ == 0) continue;
      const int own = slots() + point;
      for (int column = begin; column < end; ++column) {
        body(block_number(images_, image_of_slot[column]), own, place_of_slot_[column]);
      }
      body(block_number(images_, images_), own, own);
    }
  };
  pair_begin_.assign(block_number(blocks(), 0) + 1, 0);
  each([&](int number, int, int) { ++pair_begin_[number + 1]; });
  std::partial_sum(pair_begin_.begin(), pair_begin_.end(), pair_begin_.begin());
  pairs_.resize(pair_begin_.back());
  each([&](int number, int row, int column) {
    pairs_[pair_begin_[number]++] = {static_cast<int>(offset(row)), static_cast<int>(offset(column))};
  });
  std::shift_right(pair_begin_.begin(), pair_begin_.end(), 1);
  pair_begin_[0] = 0;
}

void PointElimination::set_zero() {
  u_.setZero();
  gradient_.setZero();
  std::fill(v_.begin(), v_.end(), Eigen::Matrix3d::Zero());
  std::fill(point_gradient_.begin(), point_gradient_.end(), Eigen::Vector3d::Zero());
}

bool PointElimination::factorize_point(int point, double damping) {
  const Eigen::Matrix3d& v = v_[point];
  const double a = v(0, 0) * (1 + damping);
  const double i00 = 1 / std::sqrt(a), l10 = v(1, 0) * i00, l20 = v(2, 0) * i00;
  const double b = v(1, 1) * (1 + damping) - l10 * l10;
  const double i11 = 1 / std::sqrt(b), l21 = (v(2, 1) - l20 * l10) * i11;
  const double c = v(2, 2) * (1 + damping) - l20 * l20 - l21 * l21;
  if (!(a > 0 && b > 0 && c > 0)) return false;
  const double i22 = 1 / std::sqrt(c), i10 = -l10 * i00 * i11;
  double* inverse = &inverse_factor_[size_t(6) * point];
  inverse[0] = i00, inverse[1] = i10, inverse[2] = i11;
  inverse[3] = -(l20 * i00 + l21 * i10) * i22, inverse[4] = -l21 * i11 * i22, inverse[5] = i22;
  const Eigen::Vector3d& g = point_gradient_[point];
  y_[point] = {i00 * g[0], i10 * g[0] + i11 * g[1], inverse[3] * g[0] + inverse[4] * g[1] + i22 * g[2]};
  return true;
}

// The Z of a point; false where its V is not positive definite.
bool PointElimination::scale_point(int point, double damping) {
  if (!factorize_point(point, damping)) return false;
  const int begin = point_begin_[point], count = point_begin_[point + 1] - begin;
  const double* inverse = &inverse_factor_[size_t(6) * point];
  scale_point_slots(padded_, count, &place_of_slot_[begin], inverse, w_.data(), z_.data());
  const int own = slots() + point;
  if (shared_ > 0) scale_point_slots(padded_, 1, &own, inverse, w_.data(), z_.data());
  return true;
}

// What belongs to the numbers of one block: their columns of S from the diagonal on, and their rows of s.
void PointElimination::reduce_column(int block) {
  const int first = block * block_, columns = block < images_ ? block_ : shared_;
  for (int column = first; column < first + columns; ++column) {
    const double* from = u_.data() + size_t(rows()) * column;
    std::copy(from + first, from + rows(),
              reduced_.begin() + static_cast<ptrdiff_t>(stride_) * column + first);
  }
  std::array<double, padded_rows(kMaxBlock)> rest = {};
  std::copy_n(gradient_.data() + first, columns, rest.begin());
  const int place = place_begin_[block];
  subtract_products(padded_, place_begin_[block + 1] - place, &z_[offset(place)], &point_of_place_[place],
                    y_[0].data(), rest.data());
  std::copy_n(rest.begin(), columns, right_.begin() + first);
  for (int row = block; row < blocks(); ++row) {
    const int begin = pair_begin_[block_number(row, block)];
    const int count = pair_begin_[block_number(row, block) + 1] - begin;
    if (count == 0) continue;
    subtract_pairs(padded_, columns, z_.data(), &pairs_[begin], count,
                   &reduced_[size_t(stride_) * first + size_t(block_) * row], stride_);
  }
}

bool PointElimination::reduce(double damping, WorkTeam& team) {
  std::atomic<bool> definite = true;
  team.run(batches(), [&](int batch) {
    for (int point = first_point(batch); point < first_point(batch + 1); ++point) {
      if (!scale_point(point, damping)) definite.store(false, std::memory_order_relaxed);
    }
  });
  if (!definite) return false;
  team.run(blocks(), [&](int block) { reduce_column(block); });
  return true;
}

bool PointElimination::factorize() {
  return factorize_dense(rows(), reduced_.data(), stride_);
}

void PointElimination::substitute_point(int point) {
  Eigen::Vector3d sum = y_[point];
  const int begin = point_begin_[point], count = point_begin_[point + 1] - begin;
  add_transposed(padded_, count, &first_row_[begin], &place_of_slot_[begin], z_.data(), numbers_.data(),
                 sum.data());
  if (shared_ > 0) {
    const int own = slots() + point, shared_row = images_ * block_;
    add_transposed(padded_, 1, &shared_row, &own, z_.data(), numbers_.data(), sum.data());
  }
  const double* i = &inverse_factor_[size_t(6) * point];
  point_steps_[point] = {-(i[0] * sum[0] + i[1] * sum[1] + i[3] * sum[2]), -(i[2] * sum[1] + i[4] * sum[2]),
                         -i[5] * sum[2]};
}

void PointElimination::substitute(const Eigen::VectorXd& c, WorkTeam& team) {
  std::copy_n(c.data(), rows(), numbers_.begin());
  team.run(batches(), [&](int batch) {
    for (int point = first_point(batch); point < first_point(batch + 1); ++point) substitute_point(point);
  });
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
