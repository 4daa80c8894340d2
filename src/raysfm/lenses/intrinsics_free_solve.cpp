#include <Eigen/Cholesky>
#include <Eigen/LU>

#include "raysfm/lenses/intrinsics_free.h"

namespace raysfm {

// S and s by rows of poses and rows of f.
void IntrinsicsFreeProblem::part_reduced_system() {
  const int images = index_.image_count(), n = 6 * images;
  const PointElimination::Matrix s = elimination_.reduced();
  const PointElimination::Vector right = elimination_.right();
  l_.resize(n, n);
  y_xf_.resize(n, n);
  capital_gamma_.resize(n, n);
  y_x_.resize(n);
  h_.resize(n);
  // The 12 rows of an image are those of its pose and those of its f; of s, the lower triangle is filled.
  enum Part { kPose = 0, kF = 6 };
  const auto block = [&s](int row, Part row_part, int column, Part column_part) {
    return s.block<6, 6>(12 * row + row_part, 12 * column + column_part);
  };
  for (int c = 0; c < images; ++c) {
    for (int r = 0; r < images; ++r) {
      if (r >= c) {
        l_.block<6, 6>(6 * r, 6 * c) = block(r, kPose, c, kPose);
        capital_gamma_.block<6, 6>(6 * r, 6 * c) = -block(r, kF, c, kF);
      }
      if (r > c) {
        y_xf_.block<6, 6>(6 * r, 6 * c) = block(r, kPose, c, kF);
      } else {
        y_xf_.block<6, 6>(6 * r, 6 * c) = block(c, kF, r, kPose).transpose();
      }
    }
    y_x_.segment<6>(6 * c) = right.segment<6>(12 * c + kPose);
    h_.segment<6>(6 * c) = right.segment<6>(12 * c + kF);
  }
}

// L, Y, y, Gamma and h of the class comment.
bool IntrinsicsFreeProblem::find_low_rank(double damping) {
  if (!elimination_.reduce(damping, team_)) return false;
  part_reduced_system();
  l_.diagonal() += damping * pose_scale_;
  Eigen::LLT<Eigen::Ref<Eigen::MatrixXd>> llt(l_);
  if (llt.info() != Eigen::Success) return false;
  llt.matrixL().solveInPlace(y_xf_);
  llt.matrixL().solveInPlace(y_x_);
  capital_gamma_.selfadjointView<Eigen::Lower>().rankUpdate(y_xf_.transpose());
  capital_gamma_.triangularView<Eigen::StrictlyUpper>() = capital_gamma_.transpose();
  h_.noalias() -= y_xf_.transpose() * y_x_;
  return true;
}

// What the rows of the constraints say of the columns of x, less the weighted mean where they are about one.
Eigen::MatrixXd IntrinsicsFreeProblem::rows_times(const Eigen::MatrixXd& x, bool exact_rows) const {
  Eigen::MatrixXd changes(rows_.size(), x.cols()), mean = Eigen::MatrixXd::Zero(5, x.cols());
  LensVector weight = LensVector::Constant(1e-300);
  for (size_t i = 0; i < rows_.size(); ++i) {
    const ConstraintRow& row = rows_[i];
    if (row.exact && !exact_rows) continue;
    changes.row(i).noalias() =
        row_coefficients_.col(i).head<6>().transpose() * x.middleRows<6>(6 * row.image);
    if (row.reference >= 0) {
      changes.row(i) += row_coefficients_.col(i).tail<6>().transpose() * x.middleRows<6>(6 * row.reference);
    } else if (row.reference == ConstraintRow::kMean) {
      const LensVector w = row.weight * row.weight * row.coefficients;
      mean.noalias() += w * changes.row(i);
      weight += w;
    }
  }
  for (size_t i = 0; i < rows_.size(); ++i) {
    const ConstraintRow& row = rows_[i];
    if ((row.exact && !exact_rows) || row.reference != ConstraintRow::kMean) continue;
    changes.row(i) -= row.coefficients.cwiseQuotient(weight).transpose() * mean;
  }
  return changes;
}

// Lambda x: what the images say of themselves, and the weighted constraints, with or without the exact ones.
Eigen::MatrixXd IntrinsicsFreeProblem::lambda_times(const Eigen::MatrixXd& x, bool exact_rows) const {
  Eigen::MatrixXd product(x.rows(), x.cols());
  for (int j = 0; j < index_.image_count(); ++j) {
    product.middleRows<6>(6 * j).noalias() = images_[j].own_lambda * x.middleRows<6>(6 * j);
  }
  Eigen::MatrixXd changes = rows_times(x, exact_rows);
  for (size_t i = 0; i < rows_.size(); ++i) {
    const ConstraintRow& row = rows_[i];
    if (row.exact && !exact_rows) continue;
    changes.row(i) *= row.weight * row.weight;
    product.middleRows<6>(6 * row.image).noalias() += row_coefficients_.col(i).head<6>() * changes.row(i);
    if (row.reference >= 0) {
      product.middleRows<6>(6 * row.reference).noalias() +=
          row_coefficients_.col(i).tail<6>() * changes.row(i);
    }
  }
  return product;
}

// The rows of the constraints that multipliers impose.
std::vector<int> IntrinsicsFreeProblem::imposed_rows() const {
  std::vector<int> imposed;
  if (options_.method != ConstraintMethod::kLagrange) return imposed;
  for (size_t i = 0; i < rows_.size(); ++i) {
    if (rows_[i].exact) imposed.push_back(static_cast<int>(i));
  }
  return imposed;
}

// z (and eta) of the class comment, and f = h - Gamma z.
bool IntrinsicsFreeProblem::solve_low_rank() {
  const int n = static_cast<int>(gamma_.size());
  const bool weighted = options_.method == ConstraintMethod::kWeights;
  const std::vector<int> imposed = imposed_rows();
  const int constraints = static_cast<int>(imposed.size());
  Eigen::VectorXd right(n + constraints);
  right.head(n) = gamma_ + lambda_times(h_, weighted);
  system_.setZero(n + constraints, n + constraints);
  system_.topLeftCorner(n, n) = lambda_times(capital_gamma_, weighted);
  system_.topLeftCorner(n, n).diagonal().array() += 1;
  for (int k = 0; k < constraints; ++k) {
    // -E^T eta in the first rows; E Gamma z = E h + c in the last.
    const ConstraintRow& row = rows_[imposed[k]];
    Eigen::VectorXd e = Eigen::VectorXd::Zero(n);
    e.segment<6>(6 * row.image) = row.weight * row_coefficients_.col(imposed[k]).head<6>();
    if (row.reference >= 0) {
      e.segment<6>(6 * row.reference) = row.weight * row_coefficients_.col(imposed[k]).tail<6>();
    }
    system_.col(n + k).head(n) = -e;
    system_.row(n + k).head(n).noalias() = e.transpose() * capital_gamma_;
    right[n + k] = e.dot(h_) + row.weight * violations_[imposed[k]];
  }
  lu_.compute(system_);
  const Eigen::VectorXd solution = lu_.solve(right);
  z_ = solution.head(n);
  eta_ = solution.tail(constraints);
  f_ = h_ - capital_gamma_ * z_;
  return z_.allFinite();
}

LmStep IntrinsicsFreeProblem::solve(double damping) {
  costs_.push_back(costs_.back());
  if (!find_low_rank(damping) || !solve_low_rank()) return {};
  const int images = index_.image_count();
  pose_steps_ = -(y_x_ + y_xf_ * z_);
  l_.triangularView<Eigen::Lower>().transpose().solveInPlace(pose_steps_);
  Eigen::VectorXd numbers(12 * images);
  for (int j = 0; j < images; ++j) {
    numbers.segment<6>(12 * j) = pose_steps_.segment<6>(6 * j);
    numbers.segment<6>(12 * j + 6) = z_.segment<6>(6 * j);
  }
  elimination_.substitute(numbers, team_);
  double along = elimination_.gradient_along_step() + gamma_.dot(f_);
  for (int j = 0; j < images; ++j) {
    along += elimination_.gradient().segment<6>(12 * j).dot(pose_steps_.segment<6>(6 * j));
  }
  const double damped =
      damping * (elimination_.scaled_step_norm() + pose_scale_.dot(pose_steps_.cwiseAbs2()));
  // With multipliers (H + D) dx = -g - F^T E^T eta, and the price of the violations is saved.
  double constrained = 0;
  const std::vector<int> imposed = imposed_rows();
  for (size_t k = 0; k < imposed.size(); ++k) {
    const double c = rows_[imposed[k]].weight * violations_[imposed[k]];
    constrained += c * (c - eta_[k]);
  }
  const double decrease = 0.5 * (damped - along + constrained);
  return {pose_steps_.allFinite() && decrease > 0, decrease};
}

Eigen::VectorXd IntrinsicsFreeProblem::step() const {
  Eigen::VectorXd all(pose_steps_.size() + 3 * index_.point_count());
  all.head(pose_steps_.size()) = pose_steps_;
  for (int i = 0; i < index_.point_count(); ++i) {
    all.segment<3>(pose_steps_.size() + 3 * i) = elimination_.point_step(i);
  }
  return all;
}

Eigen::VectorXd IntrinsicsFreeProblem::damping_scale() const {
  Eigen::VectorXd all(pose_scale_.size() + 3 * index_.point_count());
  all.head(pose_scale_.size()) = pose_scale_;
  for (int i = 0; i < index_.point_count(); ++i) {
    all.segment<3>(pose_scale_.size() + 3 * i) = const_cast<PointElimination&>(elimination_).v(i).diagonal();
  }
  return all;
}

// f reacts to the noise of the pixels, in the units of the invariant space, by f_m through the adjustment and
// by f_p through the moments of the pixels; the lens moves by their difference. With Psi = F H^-1 F^T,
// B = I - Psi Lambda and the covariance Xi of the averages of the noise alone, the difference has the
// covariance B Xi B^T - B Psi. A prior moves the adjustment by its own noise.
std::vector<Eigen::Matrix<double, 5, 5>> IntrinsicsFreeProblem::lens_covariances() {
  constexpr double kDamping = 1e-10;  // the directions that it holds do not move the lenses
  if (!find_low_rank(kDamping)) return {};
  const int n = static_cast<int>(gamma_.size());
  Eigen::MatrixXd system = lambda_times(capital_gamma_, true).transpose();
  system.diagonal().array() += 1;
  lu_.compute(system);
  const Eigen::MatrixXd b = lu_.inverse(), psi = b * capital_gamma_;
  Eigen::MatrixXd covariance = -b * psi, xi = Eigen::MatrixXd::Zero(n, n);
  for (int j = 0; j < index_.image_count(); ++j) {
    const Eigen::Matrix2d to_invariant = images_[j].t_p_inverse.linear();
    const Eigen::Matrix2d noise = to_invariant * to_invariant.transpose() / images_[j].weight;
    for (int r = 0; r < 2; ++r) {
      for (int c = 0; c < 2; ++c) {
        xi.block<3, 3>(6 * j + 3 * r, 6 * j + 3 * c).diagonal().setConstant(noise(r, c));
      }
    }
  }
  covariance += b * xi * b.transpose();
  for (size_t i = 0; i < rows_.size(); ++i) {
    if (rows_[i].exact) continue;
    const Eigen::VectorXd moved =
        rows_[i].weight * (psi.middleCols<6>(6 * rows_[i].image) * row_coefficients_.col(i).head<6>());
    covariance += moved * moved.transpose();
  }
  std::vector<Eigen::Matrix<double, 5, 5>> covariances;
  for (int j = 0; j < index_.image_count(); ++j) {
    const Eigen::Matrix<double, 5, 6> lens = images_[j].lens_by_factor * factor_change_from_averages();
    covariances.push_back(lens * covariance.block<6, 6>(6 * j, 6 * j) * lens.transpose());
  }
  return covariances;
}

}  // namespace raysfm
