#include "raysfm/bundle/scale_estimate.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "raysfm/bundle/bundle_core.h"
#include "raysfm/bundle/residual.h"

namespace raysfm {
namespace {

using Core = BundleCore<6>;

// Weight that makes the normal equations regular where nothing tells the scale, and the part of it that
// rounding leaves of an information that is not there.
constexpr double kRegularising = 1e4, kLeastPart = 1e-9;
// How far one linearisation is believed, in the scale and in its inverse: towards a smaller scale, which is
// towards where the origins of the rays matter, nothing is extrapolated that is not linear.
constexpr double kMostRatio = 4, kMostInverse = 1000;

Eigen::Vector3d origin(const Rigid3& rig_from_world) {
  return rig_from_world.inverse().translation;
}

// A function of the origins of the rigs by its derivatives: rows are poses of the problem.
using OriginGradient = Eigen::Matrix<double, Eigen::Dynamic, 3, Eigen::RowMajor>;

// The logarithm of the scale of the trajectory, as a similarity fits it.
OriginGradient log_scale(const BundleProblem& problem) {
  const int count = static_cast<int>(problem.rig_from_world.size());
  OriginGradient centred(count, 3);
  for (int i = 0; i < count; ++i) centred.row(i) = origin(problem.rig_from_world[i]);
  centred.rowwise() -= centred.colwise().mean().eval();
  return centred / centred.squaredNorm();
}

// The logarithm of the distance that the prior holds.
OriginGradient log_distance(const BundleProblem& problem) {
  const ScalePrior& prior = problem.scale_prior;
  OriginGradient gradient = OriginGradient::Zero(problem.rig_from_world.size(), 3);
  gradient.row(prior.pose) =
      (origin(problem.rig_from_world[prior.pose]) - origin(problem.rig_from_world[prior.from])) /
      (prior.distance * prior.distance);
  return gradient;
}

class Estimator {
 public:
  Estimator(const BundleProblem& problem, const BundleOptions& options)
      : problem_(problem), options_(options) {}

  // False where no observation tells the scale.
  bool run() {
    problem_.scale_prior = hold_present_scale(problem_, kRegularising);
    if (problem_.scale_prior.pose < 0 || !core_.load(problem_, options_)) return false;
    cost_ = core_.linearize();
    const OriginGradient held = log_distance(problem_), wanted = log_scale(problem_);
    set_gradient(held);
    if (!core_.solve(0).valid) return false;
    // Of the inverse of H + w p p^T to that of H, p the gradient of what is held (Sherman and Morrison).
    const double part = 1 - kRegularising * along(held);  // I / (I + w), I the information about what is held
    if (!(part > kLeastPart)) return false;
    set_gradient(wanted + held * (kRegularising * along(wanted) / part));
    if (!core_.system().solve_again(0, core_.team()).valid) return false;
    variance_ = along(wanted);
    return variance_ > 0;
  }

  ScaleEstimate estimate(std::vector<Eigen::Vector2d>* by_residual) {
    if (by_residual) by_residual->assign(problem_.observations.size(), Eigen::Vector2d::Zero());
    std::vector<double> parts(problem_.points.size(), 0.0);
    for_each_residual([&](int i, const Eigen::Vector2d& r, const Eigen::Vector2d& change) {
      parts[problem_.observations[i].point] += r.dot(change);
      if (by_residual) (*by_residual)[i] = change;
    });
    double step = 0, squares = 0;
    for (const double part : parts) step += part, squares += part * part;
    const int unknowns = 6 * core_.system().pose_count() + 3 * core_.system().point_count();
    const double sigma2 = 2 * cost_ / std::max(1, 2 * core_.used() - unknowns);
    const double independent = sigma2 * variance_;
    const double sigma = std::sqrt(std::max(independent, squares));
    // Of the scale's inverse, in which all is nearly linear, a part `step` is too much.
    const double inverse = std::clamp(1 - step, 1 / kMostRatio, kMostInverse);
    if (by_residual) {
      for (Eigen::Vector2d& change : *by_residual) change /= inverse;
    }
    return {1 / inverse, sigma / inverse, std::max(1.0, squares / independent)};
  }

 private:
  // The gradient that the unknowns answer to: by (H + hold)^-1 times it.
  void set_gradient(const OriginGradient& gradient) {
    SchurSystem<6>& system = core_.system();
    for (int i = 0; i < system.pose_count(); ++i) {
      const int pose = core_.layout().poses[i];
      Eigen::Map<Eigen::Matrix<double, 6, 1>> right(system.pose(i).gradient);
      // The origin -R^T t changes by -R^T v.
      right.head<3>() = problem_.rig_from_world[pose].rotation * gradient.row(pose).transpose();
      right.tail<3>().setZero();
    }
    for (int p = 0; p < system.point_count(); ++p) std::fill_n(system.point(p).gradient, 3, 0.0);
  }

  // How much the last solution changes a function of the origins.
  double along(const OriginGradient& gradient) {
    double sum = 0;
    for (int i = 0; i < core_.system().pose_count(); ++i) {
      const int pose = core_.layout().poses[i];
      const Eigen::Map<const Eigen::Vector3d> v(core_.system().pose_step(i));
      sum -= gradient.row(pose).dot(problem_.rig_from_world[pose].rotation.conjugate() * v);
    }
    return sum;
  }

  // The problem's state, so many times the last solution on.
  void move(double factor, std::vector<Rigid3>* poses, std::vector<Eigen::Vector3d>* points) {
    poses->assign(problem_.rig_from_world.begin(), problem_.rig_from_world.end());
    points->assign(problem_.points.begin(), problem_.points.end());
    const ObservationLayout& layout = core_.layout();
    for (size_t i = 0; i < layout.poses.size(); ++i) {
      const Eigen::Map<const Eigen::Matrix<double, 6, 1>> step(core_.system().pose_step(static_cast<int>(i)));
      Rigid3& pose = (*poses)[layout.poses[i]];
      pose = retract(pose, factor * step);
    }
    for (size_t p = 0; p < layout.points.size(); ++p) {
      const Eigen::Map<const Eigen::Vector3d> step(core_.system().point_step(static_cast<int>(p)));
      (*points)[layout.points[p]] += factor * step;
    }
  }

  // Each residual in use, and how the step of the logarithm of the scale changes with it: by differences
  // along the last solution, whose own step of it is `variance_`.
  template <typename Use>
  void for_each_residual(Use use) {
    constexpr double kDifference = 1e-5;  // of the logarithm of the scale
    const double h = kDifference / variance_;
    std::vector<Rigid3> before, after;
    std::vector<Eigen::Vector3d> points_before, points_after;
    move(-h, &before, &points_before);
    move(h, &after, &points_after);
    for (int i = 0; i < static_cast<int>(problem_.observations.size()); ++i) {
      if (!problem_.uses(i)) continue;
      const BundleObservation& o = problem_.observations[i];
      Eigen::Vector2d r, r_before, r_after;
      if (!residual_of(problem_, i, &r) ||
          !residual_of(problem_, i, before[o.pose], {}, points_before[o.point], &r_before) ||
          !residual_of(problem_, i, after[o.pose], {}, points_after[o.point], &r_after)) {
        continue;
      }
      use(i, r, (options_.loss.weight(r.squaredNorm()) / (2 * h)) * (r_before - r_after));
    }
  }

  BundleProblem problem_;
  BundleOptions options_;
  Core core_;
  double cost_ = 0, variance_ = 0;
};

}  // namespace

ScalePrior hold_present_scale(const BundleProblem& problem, double weight) {
  const auto is_free = [&](int i) { return problem.pose_is_free.empty() || problem.pose_is_free[i] != 0; };
  ScalePrior prior{.pose = -1, .from = 0, .distance = 0, .weight = weight};
  const int count = static_cast<int>(problem.rig_from_world.size());
  while (prior.from < count && is_free(prior.from)) ++prior.from;
  if (prior.from == count) return prior;
  for (int i = 0; i < count; ++i) {
    const double distance =
        (origin(problem.rig_from_world[i]) - origin(problem.rig_from_world[prior.from])).norm();
    if (is_free(i) && distance > prior.distance) prior.pose = i, prior.distance = distance;
  }
  return prior;
}

std::optional<ScaleEstimate> estimate_scale(const BundleProblem& problem, const BundleOptions& options,
                                            std::vector<Eigen::Vector2d>* by_residual) {
  if (!is_valid(problem, options) || !problem.lenses.empty() || problem.pose_is_free.empty())
    return std::nullopt;
  Estimator estimator(problem, options);
  return estimator.run() ? std::optional(estimator.estimate(by_residual)) : std::nullopt;
}

}  // namespace raysfm
