#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <span>
#include <vector>

#include "raysfm/core/paged_memory.h"
#include "raysfm/lenses/elimination_kernels.h"
#include "raysfm/optim/work_team.h"

namespace raysfm {

// Eliminates the points of a bundle adjustment whose camera blocks have any size of 6 to 12, plus numbers
// that all images share.
//
//     | U  W | | c |     | gc |    c: `block` numbers for each image, then `shared` ones; U is kept dense
//     |      | |   | = - |    |    p: 3 numbers for each point, V its 3x3 blocks
//     | W' V | | p |     | gp |    W: block x 3 where an image sees a point (a *slot*), shared x 3 a point
//
// With V = L L^T (its diagonal times 1 + damping), Z = W L^-T, y = L^-1 gp:
// S = U - sum Z Z^T, s = gc - sum Z y, and p = -L^-T (y + Z^T c) for any c. The cost is linear in points.
// Only set_structure() allocates. The bits are the same for any team.
class PointElimination {
 public:
  using Cross = Eigen::Map<Eigen::Matrix<double, Eigen::Dynamic, 3>, 0, Eigen::OuterStride<>>;
  using Matrix = Eigen::Map<Eigen::MatrixXd, 0, Eigen::OuterStride<>>;
  using Vector = Eigen::Map<Eigen::VectorXd>;

  // Slots of point i: [point_begin[i], point_begin[i + 1]), their images ascending. 6 <= block <= kMaxBlock;
  // 0 <= shared <= 8, and none with blocks of more than 8.
  void set_structure(int images, int block, int shared, std::span<const int> point_begin,
                     std::span<const int> image_of_slot);
  static constexpr int kMaxBlock = 12;

  int rows() const { return images_ * block_ + shared_; }
  int points() const { return static_cast<int>(point_begin_.size()) - 1; }

  // All but W, whose block rows are to be written, not added to.
  void set_zero();
  Eigen::MatrixXd& u() { return u_; }                // only the lower triangle is read
  Eigen::VectorXd& gradient() { return gradient_; }  // gc
  Cross w(int slot) { return cross(place_of_slot_[slot], block_); }
  Cross shared_w(int point) { return cross(slots() + point, shared_); }
  Eigen::Matrix3d& v(int point) { return v_[point]; }
  Eigen::Vector3d& point_gradient(int point) { return point_gradient_[point]; }
  // kRoom numbers for each slot that are the caller's until reduce(), which uses their memory.
  double* room(int slot) { return z_.data() + offset(place_of_slot_[slot]); }
  static constexpr int kRoom = 3 * padded_rows(6);

  // Of work by point: to be done in so many batches, batch b for [first_point(b), first_point(b + 1)).
  int batches() const { return (points() + kBatch - 1) / kBatch; }
  int first_point(int batch) const { return std::min(points(), batch * kBatch); }

  // False when a damped V is not positive definite. U is damped by the caller beforehand or afterwards.
  bool reduce(double damping, WorkTeam& team);
  // S, lower triangle.
  Matrix reduced() { return Matrix(reduced_.data(), rows(), rows(), Eigen::OuterStride<>(stride_)); }
  Vector right() { return Vector(right_.data(), rows()); }  // s

  // S becomes its Cholesky factor. False when it is not positive definite.
  bool factorize();

  // Points for the camera numbers c.
  void substitute(const Eigen::VectorXd& c, WorkTeam& team);
  const Eigen::Vector3d& point_step(int point) const { return point_steps_[point]; }

  // gp . p and sum of diag(V) p^2 of the last substitution.
  double gradient_along_step() const;
  double scaled_step_norm() const;

 private:
  int slots() const { return static_cast<int>(first_row_.size()); }
  size_t offset(int place) const { return size_t(3) * padded_ * place; }
  Cross cross(int place, int rows) {
    return Cross(&w_[offset(place)], rows, 3, Eigen::OuterStride<>(padded_));
  }
  static constexpr int kBatch = 64;
  int blocks() const { return images_ + (shared_ > 0 ? 1 : 0); }
  bool factorize_point(int point, double damping);
  bool scale_point(int point, double damping);
  void reduce_column(int block);
  void substitute_point(int point);
  void place_slots(std::span<const int> image_of_slot);
  void list_pairs(std::span<const int> image_of_slot);

  int images_ = 0, block_ = 6, shared_ = 0, padded_ = 8;
  // Between the columns of S: the kernels write beyond the end of one, but not into the next.
  int stride_ = 0;
  std::vector<int> point_begin_;
  std::vector<int> first_row_;  // of a slot: its image's
  // Image by image: the observations of an image are written one behind the other, and the sums over what two
  // images see, which are most of the work, read one stretch of memory for each.
  std::vector<int> place_of_slot_;
  std::vector<int>
      place_begin_;  // of block (image, or shared numbers) b: [place_begin_[b], place_begin_[b + 1])
  std::vector<int> point_of_place_;
  Eigen::MatrixXd u_;
  Eigen::VectorXd gradient_;
  LargeArray<double> reduced_, right_, numbers_;  // with room for the kernels
  LargeArray<double> w_;                          // by place; then of the shared numbers, by point
  ScratchArray<double> z_;                        // likewise
  std::vector<EliminationPair> pairs_;            // by block of S
  std::vector<int> pair_begin_;                   // of block (r, c), r >= c: number r (r + 1) / 2 + c
  std::vector<Eigen::Matrix3d> v_;
  std::vector<double> inverse_factor_;  // L^-1, lower by rows, 6 for each point
  std::vector<Eigen::Vector3d> point_gradient_, y_, point_steps_;
};

}  // namespace raysfm
