#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

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
class PointElimination {
 public:
  using Cross = Eigen::Map<Eigen::Matrix<double, Eigen::Dynamic, 3>>;

  // Slots of point i: [point_begin[i], point_begin[i + 1]), their images ascending. 6 <= block <= kMaxBlock.
  void set_structure(int images, int block, int shared, std::span<const int> point_begin,
                     std::span<const int> image_of_slot);
  static constexpr int kMaxBlock = 12;

  int rows() const { return images_ * block_ + shared_; }
  int points() const { return static_cast<int>(point_begin_.size()) - 1; }

  void set_zero();
  Eigen::MatrixXd& u() { return u_; }                // only the lower triangle is read
  Eigen::VectorXd& gradient() { return gradient_; }  // gc
  Cross w(int slot) { return Cross(&w_[size_t(3) * block_ * slot], block_, 3); }
  Cross shared_w(int point) { return Cross(&shared_w_[size_t(3) * shared_ * point], shared_, 3); }
  Eigen::Matrix3d& v(int point) { return v_[point]; }
  Eigen::Vector3d& point_gradient(int point) { return point_gradient_[point]; }

  // False when a damped V is not positive definite. U is damped by the caller beforehand or afterwards.
  bool reduce(double damping);
  Eigen::MatrixXd& reduced() { return reduced_; }  // S, lower triangle
  Eigen::VectorXd& right() { return right_; }      // s

  // Points for the camera numbers c.
  void substitute(const Eigen::VectorXd& c);
  const Eigen::Vector3d& point_step(int point) const { return point_steps_[point]; }

  // gp . p and sum of diag(V) p^2 of the last substitution.
  double gradient_along_step() const;
  double scaled_step_norm() const;

 private:
  bool factorize(int point, double damping);
  void scale_slots(int point);
  void subtract_shared(int point);

  using Kernel = void (*)(const double* z_row, const double* z_column, double* target, int stride);
  int images_ = 0, block_ = 6, shared_ = 0;
  Kernel kernel_ = nullptr;
  std::vector<int> point_begin_, image_of_slot_;
  Eigen::MatrixXd u_, reduced_;
  Eigen::VectorXd gradient_, right_;
  std::vector<double> w_, z_, shared_w_, shared_z_;  // by columns
  std::vector<Eigen::Matrix3d> v_, inverse_factor_;  // V and L^-1
  std::vector<Eigen::Vector3d> point_gradient_, y_, point_steps_;
};

}  // namespace raysfm
