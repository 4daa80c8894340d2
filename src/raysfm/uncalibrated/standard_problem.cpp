#include "raysfm/uncalibrated/standard_problem.h"

#include <Eigen/Cholesky>
#include <cmath>
#include <limits>

namespace raysfm {

StandardProblem::StandardProblem(const ObservationIndex& index, const LensAdjustmentOptions& options,
                                 UncalibratedScene scene)
    : index_(index),
      options_(options),
      scene_(std::move(scene)),
      trial_(scene_),
      weight_(index.weight),
      basis_(lens_basis(options.constraints)),
      free_(static_cast<int>(basis_.cols())),
      block_(shared() ? 6 : 6 + free_) {
  elimination_.set_structure(index_.image_count(), block_, shared() ? free_ : 0, index_.point_begin,
                             index_.image_of_slot);
}

double StandardProblem::cost(const UncalibratedScene& scene) {
  constexpr double kMinCosine = 1e-6;
  double sum = 0;
  for (int j = 0; j < index_.image_count(); ++j) {
    const Eigen::Matrix3d rotation = scene.cam_from_world[j].rotation.toRotationMatrix();
    const Eigen::Vector3d translation = scene.cam_from_world[j].translation;
    for (int o = index_.image_begin[j]; o < index_.image_begin[j + 1]; ++o) {
      const Eigen::Vector3d x = rotation * scene.points[index_.point_of[o]] + translation;
      if (!(x.z() > kMinCosine * x.norm())) return std::numeric_limits<double>::infinity();
      const Eigen::Vector2d m = x.head<2>() / x.z();
      sum += weight_[o] * (scene.lenses[j].pixel(m) - index_.pixel[o]).squaredNorm();
    }
    if (!(scene.lenses[j].fx > 0 && scene.lenses[j].fy > 0)) return std::numeric_limits<double>::infinity();
  }
  const double sigma = options_.constraints.principal_point_sigma;
  if (sigma > 0 && !options_.constraints.known_principal_point) {
    for (int j = 0; j < prior_count(); ++j) {
      const Eigen::Vector2d c(scene.lenses[j].cx, scene.lenses[j].cy);
      sum += (c - options_.constraints.principal_point).squaredNorm() / (sigma * sigma);
    }
  }
  return 0.5 * sum;
}

void StandardProblem::linearize_image(int j, const UncalibratedScene& scene) {
  const Eigen::Matrix3d rotation = scene.cam_from_world[j].rotation.toRotationMatrix();
  const Eigen::Vector3d translation = scene.cam_from_world[j].translation;
  const Lens& lens = scene.lenses[j];
  const Eigen::Matrix2d root = lens.matrix().topLeftCorner<2, 2>();
  constexpr int kMax = PointElimination::kMaxBlock;
  Eigen::Matrix<double, kMax, kMax> u = Eigen::Matrix<double, kMax, kMax>::Zero();
  Eigen::Matrix<double, kMax, 1> gradient = Eigen::Matrix<double, kMax, 1>::Zero();
  Eigen::Matrix<double, 2, kMax> j_camera = Eigen::Matrix<double, 2, kMax>::Zero();  // pose, then lens
  Eigen::Matrix<double, 5, 5> basis = Eigen::Matrix<double, 5, 5>::Zero();
  basis.leftCols(free_) = basis_;
  for (int o = index_.image_begin[j]; o < index_.image_begin[j + 1]; ++o) {
    const int point = index_.point_of[o];
    const Eigen::Vector3d x = rotation * scene.points[point] + translation;
    const double depth = 1 / x.z(), w = weight_[o];
    const Eigen::Vector2d m = depth * x.head<2>();
    const Eigen::Vector2d r = lens.pixel(m) - index_.pixel[o];
    Eigen::Matrix<double, 2, 3> e;
    e.leftCols<2>() = depth * root;
    e.col(2) = -depth * (root * m);
    j_camera.leftCols<3>() = e;
    for (int k = 0; k < 2; ++k) j_camera.row(k).segment<3>(3) = x.cross(e.row(k).transpose()).transpose();
    Eigen::Matrix<double, 2, 5> by_lens;
    by_lens << m.x(), 0, 1, 0, m.y(), 0, m.y(), 0, 1, 0;
    j_camera.middleCols<5>(6).noalias() = by_lens * basis;
    const Eigen::Matrix<double, 2, 3> j_point = e * rotation;

    u.noalias() += w * (j_camera.transpose() * j_camera);
    gradient.noalias() += w * (j_camera.transpose() * r);
    elimination_.v(point).noalias() += w * (j_point.transpose() * j_point);
    elimination_.point_gradient(point).noalias() += w * (j_point.transpose() * r);
    const Eigen::Matrix<double, kMax, 3> cross = w * (j_camera.transpose() * j_point);
    elimination_.w(index_.slot_of[o]) = cross.topRows(block_);
    if (shared()) elimination_.shared_w(point) += cross.middleRows(6, free_);
  }
  const int first = block_ * j, lens_first = lens_rows(j);
  elimination_.u().block<6, 6>(first, first) = u.topLeftCorner<6, 6>();
  elimination_.u().block(lens_first, first, free_, 6) = u.block(6, 0, free_, 6);
  elimination_.u().block(lens_first, lens_first, free_, free_) += u.block(6, 6, free_, free_);
  elimination_.gradient().segment<6>(first) = gradient.head<6>();
  elimination_.gradient().segment(lens_first, free_) += gradient.segment(6, free_);
}

void StandardProblem::add_priors(const UncalibratedScene& scene) {
  const double sigma = options_.constraints.principal_point_sigma;
  if (!(sigma > 0) || options_.constraints.known_principal_point) return;
  const double w = 1 / (sigma * sigma);
  const Eigen::MatrixXd axes = basis_.middleRows<2>(2);
  for (int j = 0; j < prior_count(); ++j) {
    const Eigen::Vector2d off =
        Eigen::Vector2d(scene.lenses[j].cx, scene.lenses[j].cy) - options_.constraints.principal_point;
    const int first = lens_rows(j);
    elimination_.u().block(first, first, free_, free_) += w * axes.transpose() * axes;
    elimination_.gradient().segment(first, free_) += w * axes.transpose() * off;
  }
}

void StandardProblem::normal_equations(const UncalibratedScene& scene) {
  elimination_.set_zero();
  for (int j = 0; j < index_.image_count(); ++j) linearize_image(j, scene);
  add_priors(scene);
}

double StandardProblem::linearize() {
  cost_ = cost(scene_);
  if (std::isfinite(cost_)) normal_equations(scene_);
  if (costs_.empty()) costs_.push_back(cost_);
  return cost_;
}

// The factor takes the place of the reduced system.
bool StandardProblem::factorize(double damping) {
  if (!elimination_.reduce(damping)) return false;
  elimination_.reduced().diagonal() += damping * elimination_.u().diagonal();
  Eigen::LLT<Eigen::Ref<Eigen::MatrixXd>> llt(elimination_.reduced());
  return llt.info() == Eigen::Success;
}

LmStep StandardProblem::solve(double damping) {
  costs_.push_back(costs_.back());
  if (!factorize(damping)) return {};
  steps_ = -elimination_.right();
  elimination_.reduced().triangularView<Eigen::Lower>().solveInPlace(steps_);
  elimination_.reduced().triangularView<Eigen::Lower>().transpose().solveInPlace(steps_);
  elimination_.substitute(steps_);
  const double along = elimination_.gradient_along_step() + elimination_.gradient().dot(steps_);
  const double damped =
      damping * (elimination_.scaled_step_norm() + elimination_.u().diagonal().dot(steps_.cwiseAbs2()));
  const double decrease = 0.5 * (damped - along);
  return {steps_.allFinite() && decrease > 0, decrease};
}

LmTrial StandardProblem::evaluate(bool linearize) {
  for (int j = 0; j < index_.image_count(); ++j) {
    trial_.cam_from_world[j] = retract(scene_.cam_from_world[j], steps_.segment<6>(block_ * j));
    const LensVector change = basis_ * steps_.segment(lens_rows(j), free_);
    trial_.lenses[j] = Lens::from_vector(scene_.lenses[j].vector() + change);
  }
  for (int i = 0; i < index_.point_count(); ++i)
    trial_.points[i] = scene_.points[i] + elimination_.point_step(i);
  trial_cost_ = cost(trial_);
  if (linearize && trial_cost_ <= cost_) normal_equations(trial_);
  return {cost_, trial_cost_};
}

void StandardProblem::accept() {
  std::swap(scene_, trial_);
  cost_ = trial_cost_;
  costs_.back() = cost_;
}

std::vector<Eigen::Matrix<double, 5, 5>> StandardProblem::lens_covariances() {
  constexpr double kDamping = 1e-10;  // the directions that it holds do not move the lenses
  if (!factorize(kDamping)) return {};
  std::vector<Eigen::Matrix<double, 5, 5>> covariances;
  for (int j = 0; j < index_.image_count(); ++j) {
    if (shared() && j > 0) {
      covariances.push_back(covariances[0]);
      continue;
    }
    Eigen::MatrixXd columns = Eigen::MatrixXd::Zero(elimination_.rows(), free_);
    columns.middleRows(lens_rows(j), free_).setIdentity();
    elimination_.reduced().triangularView<Eigen::Lower>().solveInPlace(columns);
    covariances.push_back(basis_ * (columns.transpose() * columns) * basis_.transpose());
  }
  return covariances;
}

}  // namespace raysfm
