#include "raysfm/projective/projective_adjustment.h"

#include <cmath>

#include "raysfm/lenses/point_elimination.h"

namespace raysfm {
namespace {

constexpr int kViewNumbers = 11;
using Vector12d = Eigen::Matrix<double, 12, 1>;

// Orthonormal basis of the directions at right angles to a unit vector: the columns but the first of the
// reflection that brings the first axis to it, up to sign.
template <int N>
Eigen::Matrix<double, N, N - 1> tangent_basis(const Eigen::Matrix<double, N, 1>& unit) {
  Eigen::Matrix<double, N, 1> v = unit;
  const double sign = v[0] < 0 ? -1 : 1;
  v[0] += sign;
  const double scale = 2 / v.squaredNorm();
  return Eigen::Matrix<double, N, N>::Identity().template rightCols<N - 1>() -
         scale * v * v.template tail<N - 1>().transpose();
}

Vector12d by_rows(const Matrix34d& view) {
  Vector12d p;
  for (int r = 0; r < 3; ++r) p.segment<4>(4 * r) = view.row(r).transpose();
  return p;
}

Matrix34d from_rows(const Vector12d& p) {
  return Eigen::Map<const Eigen::Matrix<double, 4, 3>>(p.data()).transpose();
}

class ProjectiveProblem {
 public:
  ProjectiveProblem(const ObservationIndex& index, const RobustLoss& loss, ProjectiveScene* scene)
      : index_(index), loss_(loss), scene_(*scene), trial_(*scene) {
    elimination_.set_structure(index.image_count(), kViewNumbers, 0, index.point_begin, index.image_of_slot);
  }

  double linearize() {
    normal_equations(scene_);
    return cost_ = cost(scene_);
  }

  LmStep solve(double damping) {
    if (!elimination_.reduce(damping, team_)) return {};
    elimination_.reduced().diagonal() += damping * elimination_.u().diagonal();
    if (!elimination_.factorize()) return {};
    steps_ = -elimination_.right();
    elimination_.reduced().triangularView<Eigen::Lower>().solveInPlace(steps_);
    elimination_.reduced().triangularView<Eigen::Lower>().transpose().solveInPlace(steps_);
    elimination_.substitute(steps_, team_);
    const double along = elimination_.gradient_along_step() + elimination_.gradient().dot(steps_);
    const double damped =
        damping * (elimination_.scaled_step_norm() + elimination_.u().diagonal().dot(steps_.cwiseAbs2()));
    return {steps_.allFinite() && damped > along, 0.5 * (damped - along)};
  }

  LmTrial evaluate(bool linearize) {
    for (int j = 0; j < index_.image_count(); ++j) {
      const Vector12d p = by_rows(scene_.views[j]);
      const Vector12d moved = p + tangent_basis<12>(p) * steps_.segment<kViewNumbers>(kViewNumbers * j);
      trial_.views[j] = from_rows(moved.normalized());
    }
    for (int i = 0; i < index_.point_count(); ++i) {
      const Eigen::Vector4d& x = scene_.points[i];
      trial_.points[i] = (x + tangent_basis<4>(x) * elimination_.point_step(i)).normalized();
    }
    trial_cost_ = cost(trial_);
    const bool there = linearize && trial_cost_ <= cost_;
    if (there) normal_equations(trial_);
    return {cost_, trial_cost_, there};
  }

  void accept() {
    std::swap(scene_, trial_);
    cost_ = trial_cost_;
  }

  const ProjectiveScene& scene() const { return scene_; }

 private:
  double cost(const ProjectiveScene& scene) const {
    double sum = 0;
    for (int j = 0; j < index_.image_count(); ++j) {
      for (int o = index_.image_begin[j]; o < index_.image_begin[j + 1]; ++o) {
        const Eigen::Vector3d x = scene.views[j] * scene.points[index_.point_of[o]];
        sum += loss_.cost((x.hnormalized() - index_.pixel[o]).squaredNorm());
      }
    }
    return 0.5 * sum;
  }

  void normal_equations(const ProjectiveScene& scene) {
    elimination_.set_zero();
    for (int j = 0; j < index_.image_count(); ++j) {
      const Eigen::Matrix<double, 12, kViewNumbers> view_basis = tangent_basis<12>(by_rows(scene.views[j]));
      Eigen::Matrix<double, kViewNumbers, kViewNumbers> u;
      Eigen::Matrix<double, kViewNumbers, 1> gradient;
      u.setZero();
      gradient.setZero();
      for (int o = index_.image_begin[j]; o < index_.image_begin[j + 1]; ++o) {
        const int point = index_.point_of[o];
        const Eigen::Vector4d& x = scene.points[point];
        const Eigen::Vector3d seen = scene.views[j] * x;
        const Eigen::Vector2d m = seen.hnormalized(), r = m - index_.pixel[o];
        const double w = loss_.weight(r.squaredNorm()), inverse = 1 / seen.z();
        Eigen::Matrix<double, 2, 3> projection;
        projection << inverse, 0, -inverse * m.x(), 0, inverse, -inverse * m.y();
        Eigen::Matrix<double, 2, 12> by_view;
        for (int k = 0; k < 3; ++k) by_view.middleCols<4>(4 * k) = projection.col(k) * x.transpose();
        const Eigen::Matrix<double, 2, kViewNumbers> j_view = by_view * view_basis;
        const Eigen::Matrix<double, 2, 3> j_point = projection * scene.views[j] * tangent_basis<4>(x);
        u.noalias() += w * (j_view.transpose() * j_view);
        gradient.noalias() += w * (j_view.transpose() * r);
        elimination_.v(point).noalias() += w * (j_point.transpose() * j_point);
        elimination_.point_gradient(point).noalias() += w * (j_point.transpose() * r);
        elimination_.w(index_.slot_of[o]) = w * (j_view.transpose() * j_point);
      }
      elimination_.u().block<kViewNumbers, kViewNumbers>(kViewNumbers * j, kViewNumbers * j) = u;
      elimination_.gradient().segment<kViewNumbers>(kViewNumbers * j) = gradient;
    }
  }

  const ObservationIndex& index_;
  const RobustLoss loss_;
  ProjectiveScene scene_, trial_;
  double cost_ = 0, trial_cost_ = 0;
  WorkTeam team_;  // of one
  PointElimination elimination_;
  Eigen::VectorXd steps_;
};

}  // namespace

LmSummary adjust_projective(const ObservationIndex& index, const RobustLoss& loss, const LmOptions& options,
                            ProjectiveScene* scene) {
  for (Matrix34d& view : scene->views) view.normalize();
  for (Eigen::Vector4d& point : scene->points) point.normalize();
  ProjectiveProblem problem(index, loss, scene);
  const LmSummary summary = levenberg_marquardt(problem, options);
  *scene = problem.scene();
  return summary;
}

}  // namespace raysfm
