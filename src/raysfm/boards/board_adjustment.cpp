#include "raysfm/boards/board_adjustment.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>

#include "raysfm/camera/model_check.h"
#include "raysfm/camera/model_starts.h"
#include "raysfm/robust/pose_refinement.h"

namespace raysfm {
namespace {

using Matrix26d = Eigen::Matrix<double, 2, 6>;

constexpr double kNumberStep = 1e-6;  // of a number's scale

// Derivative of exp(delta) * x by the tangent delta, see retract().
Eigen::Matrix<double, 3, 6> by_tangent(const Eigen::Vector3d& x) {
  Eigen::Matrix<double, 3, 6> d;
  d << Eigen::Matrix3d::Identity(), -skew(x);
  return d;
}

// Where the unknowns of the cameras stand in a row: of each its free numbers, then the six of its pose.
struct CameraUnknowns {
  std::vector<std::vector<int>> free;  // numbers of each camera's model
  std::vector<int> begin;              // of each camera, and the end of the last

  explicit CameraUnknowns(const BoardProblem& problem) {
    begin.push_back(0);
    for (size_t c = 0; c < problem.rig.cameras.size(); ++c) {
      std::vector<int>& numbers = free.emplace_back();
      for (size_t i = 0; i < problem.scales[c].size(); ++i) {
        if (problem.scales[c][i] > 0) numbers.push_back(static_cast<int>(i));
      }
      begin.push_back(begin.back() + static_cast<int>(numbers.size()) + (c > 0 ? 6 : 0));
    }
  }
  int count() const { return begin.back(); }
  int pose(int c) const { return begin[c] + static_cast<int>(free[c].size()); }
};

// Normal equations of one view: those of the cameras, of the pose of the rig, and what couples them.
struct ViewEquations {
  Eigen::MatrixXd cameras, coupling;  // n x n, 6 x n
  Matrix6d pose = Matrix6d::Zero();
  Eigen::VectorXd camera_gradient;
  Vector6d pose_gradient = Vector6d::Zero();

  explicit ViewEquations(int count)
      : cameras(Eigen::MatrixXd::Zero(count, count)),
        coupling(Eigen::MatrixXd::Zero(6, count)),
        camera_gradient(Eigen::VectorXd::Zero(count)) {}
};

// A camera with its models next to it, a step of each free number to both sides.
struct CameraModels {
  std::vector<Camera> plus, minus;

  CameraModels(const Camera& camera, const std::vector<double>& scales, const std::vector<int>& free) {
    const std::vector<double> numbers = model_numbers(camera.model);
    for (const int i : free) {
      std::vector<double> moved = numbers;
      moved[i] = numbers[i] + kNumberStep * scales[i];
      plus.push_back(camera);
      plus.back().model = with_model_numbers(camera.model, moved);
      moved[i] = numbers[i] - kNumberStep * scales[i];
      minus.push_back(camera);
      minus.back().model = with_model_numbers(camera.model, moved);
    }
  }
};

Rig rig_with_step(const BoardProblem& problem, const CameraUnknowns& unknowns, const Eigen::VectorXd& step) {
  Rig rig = problem.rig;
  for (int c = 0; c < static_cast<int>(rig.cameras.size()); ++c) {
    std::vector<double> numbers = model_numbers(rig.cameras[c].model);
    for (size_t k = 0; k < unknowns.free[c].size(); ++k) {
      const int i = unknowns.free[c][k];
      numbers[i] += problem.scales[c][i] * step[unknowns.begin[c] + static_cast<Eigen::Index>(k)];
    }
    rig.cameras[c].model = with_model_numbers(rig.cameras[c].model, numbers);
    if (c == 0) continue;
    const Vector6d turn = step.segment<6>(unknowns.pose(c));
    rig.cameras[c].rig_from_cam = retract(rig.cameras[c].rig_from_cam.inverse(), turn).inverse();
  }
  return rig;
}

// What levenberg_marquardt() minimises. The poses of the views are eliminated from the normal equations.
class BoardMinimisation {
 public:
  BoardMinimisation(BoardProblem* problem, const RobustLoss& loss)
      : problem_(*problem), loss_(loss), unknowns_(*problem) {
    for (const Camera& camera : problem_.rig.cameras) {
      missing_ = std::max({missing_, double(camera.width), double(camera.height)});
    }
  }

  const CameraUnknowns& unknowns() const { return unknowns_; }
  const std::vector<ViewEquations>& views() const { return views_; }

  double linearize() {
    const int n = unknowns_.count();
    views_.assign(problem_.rig_from_board.size(), ViewEquations(n));
    std::vector<CameraModels> models;
    for (size_t c = 0; c < problem_.rig.cameras.size(); ++c) {
      models.emplace_back(problem_.rig.cameras[c], problem_.scales[c], unknowns_.free[c]);
    }
    for (const BoardObservation& o : problem_.observations) add(o, models[o.camera]);
    return cost_ = cost_of(problem_);
  }

  LmStep solve(double lambda) {
    const int n = unknowns_.count();
    Eigen::MatrixXd reduced = Eigen::MatrixXd::Zero(n, n);
    Eigen::VectorXd right = Eigen::VectorXd::Zero(n);
    std::vector<Eigen::LLT<Matrix6d>> factors;
    for (const ViewEquations& view : views_) {
      Matrix6d pose = view.pose;
      pose.diagonal() += lambda * view.pose.diagonal() + Vector6d::Constant(1e-12);
      const Eigen::LLT<Matrix6d>& factor = factors.emplace_back(pose);
      if (factor.info() != Eigen::Success) return {};
      reduced += view.cameras - view.coupling.transpose() * factor.solve(view.coupling);
      right -= view.camera_gradient - view.coupling.transpose() * factor.solve(view.pose_gradient);
      for (int i = 0; i < n; ++i) reduced(i, i) += lambda * view.cameras(i, i);
    }
    reduced.diagonal() += Eigen::VectorXd::Constant(n, 1e-12);
    const Eigen::LLT<Eigen::MatrixXd> factor(reduced);
    if (factor.info() != Eigen::Success) return {};
    const Eigen::VectorXd step = factor.solve(right);
    if (!step.allFinite()) return {};
    trial_ = problem_;
    trial_.rig = rig_with_step(problem_, unknowns_, step);
    double decrease = 0;
    for (size_t v = 0; v < views_.size(); ++v) {
      const ViewEquations& view = views_[v];
      const Vector6d turn = factors[v].solve(-view.pose_gradient - view.coupling * step);
      trial_.rig_from_board[v] = retract(problem_.rig_from_board[v], turn);
      decrease -= step.dot(view.camera_gradient) + turn.dot(view.pose_gradient);
      decrease -= 0.5 * (step.dot(view.cameras * step) + turn.dot(view.pose * turn));
      decrease -= turn.dot(view.coupling * step);
    }
    return {true, decrease};
  }

  LmTrial evaluate(bool linearize_there) {
    const double before = cost_;
    const bool possible = std::ranges::none_of(
        trial_.rig.cameras, [](const Camera& camera) { return find_problem(camera.model).has_value(); });
    if (!possible) return {before, INFINITY};
    const double after = cost_of(trial_);
    if (!linearize_there || !(after <= before)) return {before, after};
    std::swap(problem_, trial_);
    linearize();
    std::swap(problem_, trial_);
    return {before, after, true};
  }

  void accept() {
    std::swap(problem_, trial_);
    cost_ = cost_of(problem_);
  }

 private:
  double cost_of(const BoardProblem& problem) const {
    double cost = 0;
    for (const BoardObservation& o : problem.observations) {
      Eigen::Vector2d residual;
      const bool seen = board_residual(problem, o, &residual);
      cost += 0.5 * loss_.cost(seen ? residual.squaredNorm() : missing_ * missing_);
    }
    return cost;
  }

  void add(const BoardObservation& o, const CameraModels& models) {
    const Camera& camera = problem_.rig.cameras[o.camera];
    const Rigid3 cam_from_rig = camera.rig_from_cam.inverse();
    const Eigen::Vector3d in_rig = problem_.rig_from_board[o.view] * problem_.board.corner(o.corner);
    const Eigen::Vector3d in_cam = cam_from_rig * in_rig;
    Eigen::Vector2d pixel;
    Eigen::Matrix<double, 2, 3> by_point;
    if (!camera.project(in_cam, &pixel, &by_point)) return;
    const Eigen::Vector2d residual = pixel - o.pixel;
    const double weight = loss_.weight(residual.squaredNorm());
    const int begin = unknowns_.begin[o.camera], count = unknowns_.begin[o.camera + 1] - begin;
    Eigen::MatrixXd by_camera(2, count);
    for (size_t k = 0; k < models.plus.size(); ++k) {
      Eigen::Vector2d plus, minus;
      // What comes or goes within the step has no derivative.
      const bool both = models.plus[k].project(in_cam, &plus) && models.minus[k].project(in_cam, &minus);
      by_camera.col(static_cast<Eigen::Index>(k)) =
          both ? Eigen::Vector2d((plus - minus) / (2 * kNumberStep)) : Eigen::Vector2d::Zero();
    }
    if (o.camera > 0) by_camera.rightCols<6>() = by_point * by_tangent(in_cam);
    const Matrix26d by_pose = by_point * cam_from_rig.rotation.toRotationMatrix() * by_tangent(in_rig);
    ViewEquations& view = views_[o.view];
    view.cameras.block(begin, begin, count, count) += weight * by_camera.transpose() * by_camera;
    view.coupling.middleCols(begin, count) += weight * by_pose.transpose() * by_camera;
    view.pose += weight * by_pose.transpose() * by_pose;
    view.camera_gradient.segment(begin, count) += weight * by_camera.transpose() * residual;
    view.pose_gradient += weight * by_pose.transpose() * residual;
  }

  BoardProblem& problem_;
  BoardProblem trial_;
  RobustLoss loss_;
  CameraUnknowns unknowns_;
  std::vector<ViewEquations> views_;
  double missing_ = 1, cost_ = 0;
};

// What is known of the unknowns of the cameras at the minimum.
class BoardUncertainty {
 public:
  // Of each view what it tells of them, and the gradient there; `variance` of one residual.
  BoardUncertainty(const std::vector<Eigen::MatrixXd>& of_views,
                   const std::vector<Eigen::VectorXd>& gradients, const Eigen::MatrixXd& all, double variance)
      : eigen_(all), variance_(variance) {
    const double views = static_cast<double>(of_views.size());
    for (size_t v = 0; v < of_views.size(); ++v) {
      const Eigen::LDLT<Eigen::MatrixXd> without(all - of_views[v]);
      const Eigen::VectorXd change = without.solve(gradients[v]);
      if (without.info() != Eigen::Success || !change.allFinite()) continue;
      changes_.push_back(change * std::sqrt((views - 1) / views));
    }
  }

  // Standard deviation of a sum of the unknowns; infinite where it contains what the views leave open.
  double sigma(const Eigen::VectorXd& weights) const {
    constexpr double kOpen = 1e-14, kPart = 1e-6;
    double told = 0, jackknife = 0;
    for (Eigen::Index k = 0; k < weights.size(); ++k) {
      const double value = eigen_.eigenvalues()[k], part = eigen_.eigenvectors().col(k).dot(weights);
      const bool open = !(value > kOpen * eigen_.eigenvalues().maxCoeff());
      if (open && part * part > kPart * weights.squaredNorm()) return std::numeric_limits<double>::infinity();
      if (!open) told += variance_ * part * part / value;
    }
    for (const Eigen::VectorXd& change : changes_) jackknife += std::pow(change.dot(weights), 2);
    return std::sqrt(std::max(told, jackknife));
  }

 private:
  Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen_;
  double variance_;
  std::vector<Eigen::VectorXd> changes_;  // that leaving out one view makes, one after the other
};

BoardUncertainty uncertainty_of(const BoardProblem& problem, const CameraUnknowns& unknowns) {
  BoardProblem copy = problem;
  BoardMinimisation minimisation(&copy, {});
  const double cost = minimisation.linearize();
  const int n = unknowns.count();
  Eigen::MatrixXd all = Eigen::MatrixXd::Zero(n, n);
  std::vector<Eigen::MatrixXd> of_views;
  std::vector<Eigen::VectorXd> gradients;
  for (const ViewEquations& view : minimisation.views()) {
    if (view.pose.isZero()) continue;
    const Eigen::LDLT<Matrix6d> pose(view.pose);
    of_views.push_back(view.cameras - view.coupling.transpose() * pose.solve(view.coupling));
    gradients.push_back(view.camera_gradient - view.coupling.transpose() * pose.solve(view.pose_gradient));
    all += of_views.back();
  }
  const double freedom =
      2.0 * static_cast<double>(problem.observations.size()) - n - 6.0 * static_cast<double>(of_views.size());
  return {of_views, gradients, all, 2 * cost / std::max(1.0, freedom)};
}

// Derivative of the logarithm of the pixels per radian of a camera by all unknowns.
Eigen::VectorXd by_focal(const BoardProblem& problem, const CameraUnknowns& unknowns, int c) {
  constexpr double kStep = 1e-4;
  Eigen::VectorXd gradient = Eigen::VectorXd::Zero(unknowns.count());
  for (size_t k = 0; k < unknowns.free[c].size(); ++k) {
    const int i = unknowns.free[c][k];
    const auto density = [&](double step) {
      Camera camera = problem.rig.cameras[c];
      std::vector<double> numbers = model_numbers(camera.model);
      numbers[i] += step * problem.scales[c][i];
      camera.model = with_model_numbers(camera.model, numbers);
      return camera.pixels_per_radian();
    };
    gradient[unknowns.begin[c] + static_cast<Eigen::Index>(k)] =
        (density(kStep) - density(-kStep)) / (2 * kStep * density(0));
  }
  return gradient;
}

}  // namespace

bool board_residual(const BoardProblem& problem, const BoardObservation& o, Eigen::Vector2d* residual) {
  const Camera& camera = problem.rig.cameras[o.camera];
  const Eigen::Vector3d in_rig = problem.rig_from_board[o.view] * problem.board.corner(o.corner);
  Eigen::Vector2d pixel;
  if (!camera.project(camera.rig_from_cam.inverse() * in_rig, &pixel)) return false;
  *residual = pixel - o.pixel;
  return residual->allFinite();
}

LmSummary adjust_boards(const RobustLoss& loss, int max_iterations, BoardProblem* problem) {
  BoardMinimisation minimisation(problem, loss);
  return levenberg_marquardt(
      minimisation,
      {.max_iterations = max_iterations, .min_relative_decrease = 1e-10, .initial_damping = 1e-3});
}

BoardSigmas board_sigmas(const BoardProblem& problem) {
  const CameraUnknowns unknowns(problem);
  const BoardUncertainty uncertainty = uncertainty_of(problem, unknowns);
  const auto sigma = [&](Eigen::Index i) {
    return uncertainty.sigma(Eigen::VectorXd::Unit(unknowns.count(), i));
  };
  BoardSigmas result;
  for (int c = 0; c < static_cast<int>(problem.rig.cameras.size()); ++c) {
    std::vector<double>& numbers = result.numbers.emplace_back(problem.scales[c].size(), 0.0);
    for (size_t k = 0; k < unknowns.free[c].size(); ++k) {
      const int i = unknowns.free[c][k];
      numbers[i] = problem.scales[c][i] * sigma(unknowns.begin[c] + static_cast<Eigen::Index>(k));
    }
    const double focal = uncertainty.sigma(by_focal(problem, unknowns, c));
    result.focal.push_back(std::isfinite(focal) ? focal : std::numeric_limits<double>::infinity());
    Vector6d& pose = result.pose.emplace_back(Vector6d::Zero());
    for (int i = 0; c > 0 && i < 6; ++i) pose[i] = sigma(unknowns.pose(c) + i);
  }
  return result;
}

}  // namespace raysfm
