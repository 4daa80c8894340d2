#include "raysfm/bundle/covariance.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <cmath>
#include <limits>

#include "raysfm/bundle/bundle_core.h"
#include "raysfm/bundle/gauge.h"

namespace raysfm {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

// L^-1 of a point's V = L L^T, as the elimination keeps it.
template <int N>
Eigen::Matrix3d point_factor(const SchurSystem<N>& system, int p) {
  const double* f = system.point_factor(p);
  return Eigen::Matrix3d{{f[0], 0, 0}, {f[1], f[2], 0}, {f[3], f[4], f[5]}};
}

template <int N>
Eigen::Matrix<double, N, 3> scaled_cross(const SchurSystem<N>& system, int slot) {
  Eigen::Matrix<double, N, 3> z;
  for (int c = 0; c < 3; ++c) {
    for (int r = 0; r < N; ++r) z(r, c) = system.cross(slot)[cross_place<N>(r, c)];
  }
  return z;
}

// Whether all rays that see the point are nearly the same one, so that V is singular.
bool is_undetermined(const PointBlock& point) {
  constexpr double kLeastRatio = 1e-13;
  const double* v = point.v;
  Eigen::Matrix3d m{{v[0], v[1], v[2]}, {v[1], v[3], v[4]}, {v[2], v[4], v[5]}};
  const Eigen::Vector3d values = Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(m).eigenvalues();
  return !(values[0] > kLeastRatio * values[2]);
}

// The covariance up to sigma2, block by block from solutions of the normal equations.
template <int N>
class Covariance {
 public:
  Covariance(const BundleProblem& problem, const BundleOptions& options) : options_(options) {
    problem_ = problem;
    is_inlier_.assign(problem.observations.size(), 1);
    if (!problem.is_inlier.empty()) is_inlier_.assign(problem.is_inlier.begin(), problem.is_inlier.end());
    problem_.is_inlier = is_inlier_;
  }

  Result<BundleCovariance> run(double known_sigma) {
    if (!load()) return no_reconstruction("covariance: nothing in the problem can move");
    const double cost = core_.linearize();
    gauge_ = find_gauge(problem_, core_.layout(), core_.system());
    BundleCovariance result;
    result.gauge_freedoms = gauge_.directions();
    const Result<double> sigma2 = variance(cost, known_sigma);
    if (!sigma2) return sigma2.error();
    result.sigma2 = *sigma2;
    fix_gauge();
    if (!core_.solve(0).valid) {
      return no_reconstruction("covariance: the observations leave more than the gauge of the problem free");
    }
    prepare_projection();
    result.poses.assign(problem_.rig_from_world.size(), Eigen::Matrix<double, 6, 6>::Zero());
    result.points.assign(problem_.points.size(), Eigen::Matrix3d::Zero());
    mark_free(&result);
    fill(&result);
    return result;
  }

 private:
  // Without the observations of points that they do not determine: these say nothing about the poses.
  bool load() {
    for (int round = 0; round < 2; ++round) {
      if (!core_.load(problem_, options_)) return false;
      core_.linearize();
      if (core_.used() == 0) return false;
      bool removed = false;
      undetermined_.resize(problem_.points.size(), 0);
      for (size_t p = 0; p < core_.layout().points.size(); ++p) {
        if (!is_undetermined(core_.system().point(static_cast<int>(p)))) continue;
        undetermined_[core_.layout().points[p]] = 1;
        removed = true;
      }
      if (!removed) return true;
      for (size_t i = 0; i < is_inlier_.size(); ++i) {
        if (undetermined_[problem_.observations[i].point]) is_inlier_[i] = 0;
      }
    }
    return core_.load(problem_, options_);
  }

  Result<double> variance(double cost, double known_sigma) const {
    if (known_sigma > 0) return known_sigma * known_sigma;
    const auto& layout = core_.layout();
    const int64_t unknowns =
        N * int64_t(layout.poses.size()) + 3 * int64_t(layout.points.size()) - gauge_.directions();
    const int64_t freedoms = 2 * int64_t(core_.used()) - unknowns;
    if (freedoms <= 0) {
      return no_reconstruction("covariance: " + std::to_string(2 * core_.used()) + " residuals for " +
                               std::to_string(unknowns) + " unknowns: no estimate of sigma");
    }
    return 2.0 * cost / static_cast<double>(freedoms);
  }

  // Weight on as many single numbers of poses as the gauge has directions. The inverse then is one of H in
  // the space that the observations see, and the projection below removes what it holds beyond.
  void fix_gauge() {
    Eigen::MatrixXd rows = gauge_.poses;
    for (Eigen::Index k = 0; k < rows.rows(); ++k) rows.row(k) *= std::sqrt(diagonal(k));
    for (int d = 0; d < gauge_.directions(); ++d) {
      Eigen::Index row, column;
      rows.rightCols(rows.cols() - d).cwiseAbs().maxCoeff(&row, &column);
      rows.col(d).swap(rows.col(d + column));
      const Eigen::VectorXd pivot = rows.col(d) / rows(row, d);
      for (Eigen::Index c = d + 1; c < rows.cols(); ++c) rows.col(c) -= (pivot * rows(row, c)).eval();
      diagonal(row) *= 2;
    }
  }

  double& diagonal(Eigen::Index row) {
    return core_.system().pose(static_cast<int>(row / N)).u[(N + 1) * (row % N)];
  }

  // (H + gauge)^-1 applied to a column of poses and points.
  void solve(Eigen::VectorXd* poses, Eigen::VectorXd* points) {
    SchurSystem<N>& system = core_.system();
    for (int p = 0; p < system.point_count(); ++p) {
      const Eigen::Vector3d y = point_factor(system, p) * points->segment<3>(3 * p);
      points->segment<3>(3 * p) = y;
      for (int s = system.point_begin(p); s < system.point_begin(p + 1); ++s) {
        poses->segment<N>(N * system.pose_of_slot(s)) -= scaled_cross(system, s) * y;
      }
    }
    system.solve_reduced({poses->data(), static_cast<size_t>(poses->size())});
    for (int p = 0; p < system.point_count(); ++p) {
      Eigen::Vector3d y = points->segment<3>(3 * p);
      for (int s = system.point_begin(p); s < system.point_begin(p + 1); ++s) {
        y -= scaled_cross(system, s).transpose() * poses->segment<N>(N * system.pose_of_slot(s));
      }
      points->segment<3>(3 * p) = point_factor(system, p).transpose() * y;
    }
  }

  // The pseudo-inverse is P G P with G the inverse above, P = I - F A F^T, A = (F^T F)^-1 and F the gauge: a
  // block is G_ii - B_i F_i^T - F_i B_i^T + F_i C F_i^T with B = G F A and C = A F^T G F A.
  void prepare_projection() {
    const int d = gauge_.directions();
    if (d == 0) return;
    const Eigen::MatrixXd a =
        (gauge_.poses.transpose() * gauge_.poses + gauge_.points.transpose() * gauge_.points).inverse();
    solved_ = gauge_;
    for (int k = 0; k < d; ++k) {
      Eigen::VectorXd poses = gauge_.poses.col(k), points = gauge_.points.col(k);
      solve(&poses, &points);
      solved_.poses.col(k) = poses, solved_.points.col(k) = points;
    }
    inner_ = a * (gauge_.poses.transpose() * solved_.poses + gauge_.points.transpose() * solved_.points) * a;
    solved_.poses = (solved_.poses * a).eval();
    solved_.points = (solved_.points * a).eval();
  }

  template <int kRows>
  Eigen::Matrix<double, kRows, kRows> project(const Eigen::Matrix<double, kRows, kRows>& block,
                                              const Eigen::MatrixXd& solved, const Eigen::MatrixXd& gauge,
                                              Eigen::Index row) const {
    if (gauge_.directions() == 0) return block;
    const Eigen::MatrixXd b = solved.middleRows<kRows>(row), f = gauge.middleRows<kRows>(row);
    return block - b * f.transpose() - f * b.transpose() + f * inner_ * f.transpose();
  }

  // What fill() does not come to is not determined.
  void mark_free(BundleCovariance* result) const {
    for (size_t i = 0; i < result->poses.size(); ++i) {
      if (problem_.pose_is_free.empty() || problem_.pose_is_free[i]) result->poses[i].setConstant(kNan);
    }
    for (size_t p = 0; p < result->points.size(); ++p) {
      if (problem_.point_is_fixed.empty() || !problem_.point_is_fixed[p]) result->points[p].setConstant(kNan);
    }
  }

  // Column by column of the inverse of the reduced system: each gives the block of its pose, and its part of
  // V^-1 + V^-1 W^T S^-1 W V^-1 to the points that the pose sees.
  void fill(BundleCovariance* result) {
    SchurSystem<N>& system = core_.system();
    const ObservationLayout& layout = core_.layout();
    std::vector<Eigen::Matrix3d> seen(layout.points.size(), Eigen::Matrix3d::Identity());
    Eigen::Matrix<double, Eigen::Dynamic, N> columns(N * system.pose_count(), N);
    for (int j = 0; j < system.pose_count(); ++j) {
      columns.setZero();
      columns.template middleRows<N>(N * j).setIdentity();
      for (int c = 0; c < N; ++c) {
        system.solve_reduced({columns.col(c).data(), static_cast<size_t>(columns.rows())});
      }
      const Eigen::Matrix<double, N, N> block = columns.template middleRows<N>(N * j);
      result->poses[layout.poses[j]] =
          result->sigma2 *
          project<N>(block, solved_.poses, gauge_.poses, N * j).template topLeftCorner<6, 6>();
      for (int s : system.slots_of_pose(j)) {
        const int p = system.point_of_slot(s);
        const Eigen::Matrix<double, N, 3> z = scaled_cross(system, s);
        for (int t = system.point_begin(p); t < system.point_begin(p + 1); ++t) {
          seen[p] += scaled_cross(system, t).transpose() *
                     columns.template middleRows<N>(N * system.pose_of_slot(t)) * z;
        }
      }
    }
    for (size_t p = 0; p < seen.size(); ++p) {
      const Eigen::Matrix3d f = point_factor(system, static_cast<int>(p));
      const Eigen::Matrix3d block = f.transpose() * seen[p] * f;
      result->points[layout.points[p]] =
          result->sigma2 * project<3>(block, solved_.points, gauge_.points, 3 * static_cast<Eigen::Index>(p));
    }
  }

  BundleProblem problem_;
  BundleOptions options_;
  std::vector<uint8_t> is_inlier_, undetermined_;
  BundleCore<N> core_;
  Gauge gauge_;
  Gauge solved_;           // B
  Eigen::MatrixXd inner_;  // C
};

}  // namespace

Result<BundleCovariance> bundle_covariance(const BundleProblem& problem, const BundleOptions& options,
                                           double known_sigma) {
  if (!is_valid(problem, options)) {
    return bad_input("covariance: sizes or indices of the problem contradict each other");
  }
  if (!(known_sigma >= 0) || !std::isfinite(known_sigma)) {
    return bad_input("covariance: known_sigma: " + std::to_string(known_sigma) + ": must be at least 0");
  }
  if (!problem.lenses.empty()) return Covariance<9>(problem, options).run(known_sigma);
  return Covariance<6>(problem, options).run(known_sigma);
}

}  // namespace raysfm
