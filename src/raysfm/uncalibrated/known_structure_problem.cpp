#include "raysfm/uncalibrated/known_structure_problem.h"

#include <Eigen/Cholesky>
#include <cmath>
#include <limits>

namespace raysfm {
namespace {

constexpr double kMinCosine = 1e-6;
constexpr double kInfinity = std::numeric_limits<double>::infinity();

}  // namespace

KnownStructureProblem::KnownStructureProblem(const ObservationIndex& index,
                                             const LensConstraints& constraints, UncalibratedScene scene,
                                             const RadialDistortion& distortion)
    : index_(index),
      constraints_(constraints),
      basis_(lens_basis(constraints)),
      free_(static_cast<int>(basis_.cols()) + (constraints.equal ? 2 : 0)),
      state_{std::move(scene), distortion},
      trial_(state_),
      blocks_(index.image_count()),
      steps_(index.image_count()) {}

double KnownStructureProblem::cost(const State& state) const {
  double sum = 0;
  for (int j = 0; j < index_.image_count(); ++j) {
    const Lens& lens = state.scene.lenses[j];
    if (!(lens.fx > 0 && lens.fy > 0)) return kInfinity;
    for (int o = index_.image_begin[j]; o < index_.image_begin[j + 1]; ++o) {
      const Eigen::Vector3d x = state.scene.cam_from_world[j] * state.scene.points[index_.point_of[o]];
      if (!(x.z() > kMinCosine * x.norm())) return kInfinity;
      const Eigen::Vector2d m = state.distortion(x.hnormalized());
      sum += index_.weight[o] * (lens.pixel(m) - index_.pixel[o]).squaredNorm();
    }
  }
  const double sigma = constraints_.principal_point_sigma;
  for (int j = 0; j < lens_count() && sigma > 0; ++j) {
    const Eigen::Vector2d centre(state.scene.lenses[j].cx, state.scene.lenses[j].cy);
    sum += (centre - constraints_.principal_point).squaredNorm() / (sigma * sigma);
  }
  return 0.5 * sum;
}

// Numbers of an image: its pose, then its lens where that is its own.
void KnownStructureProblem::linearize_image(int j, const State& state) {
  const Rigid3& pose = state.scene.cam_from_world[j];
  const Lens& lens = state.scene.lenses[j];
  const Eigen::Matrix2d root = lens.matrix().topLeftCorner<2, 2>();
  using Columns = Eigen::Matrix<double, 2, 6 + kMaxLens>;
  Eigen::Matrix<double, 6 + kMaxLens, 6 + kMaxLens> u =
      Eigen::Matrix<double, 6 + kMaxLens, 6 + kMaxLens>::Zero();
  Eigen::Matrix<double, 6 + kMaxLens, 1> gradient = Eigen::Matrix<double, 6 + kMaxLens, 1>::Zero();
  const int own = static_cast<int>(basis_.cols());
  for (int o = index_.image_begin[j]; o < index_.image_begin[j + 1]; ++o) {
    const Eigen::Vector3d x = pose * state.scene.points[index_.point_of[o]];
    const Eigen::Vector2d plain = x.hnormalized(), m = state.distortion(plain);
    const double r2 = plain.squaredNorm();
    const Eigen::Vector2d residual = lens.pixel(m) - index_.pixel[o];
    Eigen::Matrix<double, 2, 3> by_point;
    by_point << 1, 0, -plain.x(), 0, 1, -plain.y();
    by_point = root * state.distortion.jacobian(plain) * by_point / x.z();
    Eigen::Matrix<double, 2, 5> by_lens;
    by_lens << m.x(), 0, 1, 0, m.y(), 0, m.y(), 0, 1, 0;
    Columns columns = Columns::Zero();
    columns.leftCols<3>() = by_point;
    for (int k = 0; k < 2; ++k) columns.row(k).segment<3>(3) = x.cross(by_point.row(k).transpose());
    columns.middleCols(6, own) = by_lens * basis_;
    if (constraints_.equal) {
      columns.col(6 + own) = r2 * (root * plain);
      columns.col(7 + own) = r2 * r2 * (root * plain);
    }
    u.noalias() += index_.weight[o] * columns.transpose() * columns;
    gradient.noalias() += index_.weight[o] * columns.transpose() * residual;
  }
  Block& block = blocks_[j];
  const int size = constraints_.equal ? 6 : 6 + free_;
  block.u = u.topLeftCorner(size, size);
  block.gradient = gradient.head(size);
  if (!constraints_.equal) return;
  block.cross = u.block(0, 6, 6, free_);
  shared_ += u.block(6, 6, free_, free_);
  shared_gradient_ += gradient.segment(6, free_);
}

void KnownStructureProblem::add_prior(const State& state) {
  const double sigma = constraints_.principal_point_sigma;
  if (!(sigma > 0)) return;
  const int own = static_cast<int>(basis_.cols());
  const Eigen::MatrixXd axes = basis_.middleRows<2>(2) / sigma;
  for (int j = 0; j < lens_count(); ++j) {
    const Eigen::Vector2d off =
        (Eigen::Vector2d(state.scene.lenses[j].cx, state.scene.lenses[j].cy) - constraints_.principal_point) /
        sigma;
    Eigen::MatrixXd& u = constraints_.equal ? shared_ : blocks_[j].u;
    Eigen::VectorXd& gradient = constraints_.equal ? shared_gradient_ : blocks_[j].gradient;
    const int first = constraints_.equal ? 0 : 6;
    u.block(first, first, own, own) += axes.transpose() * axes;
    gradient.segment(first, own) += axes.transpose() * off;
  }
}

void KnownStructureProblem::normal_equations(const State& state) {
  const int shared = constraints_.equal ? free_ : 0;
  shared_ = Eigen::MatrixXd::Zero(shared, shared);
  shared_gradient_ = Eigen::VectorXd::Zero(shared);
  for (int j = 0; j < index_.image_count(); ++j) linearize_image(j, state);
  add_prior(state);
}

double KnownStructureProblem::linearize() {
  cost_ = cost(state_);
  if (std::isfinite(cost_)) normal_equations(state_);
  return cost_;
}

// What is left for the shared numbers when every image has its best own ones.
bool KnownStructureProblem::eliminate(double damping) {
  reduced_ = shared_;
  reduced_.diagonal() *= 1 + damping;
  right_ = shared_gradient_;
  for (Block& block : blocks_) {
    Eigen::MatrixXd damped = block.u;
    damped.diagonal() *= 1 + damping;
    const Eigen::LLT<Eigen::MatrixXd> llt(damped);
    if (llt.info() != Eigen::Success) return false;
    block.inverse = llt.solve(Eigen::MatrixXd::Identity(damped.rows(), damped.cols()));
    if (!constraints_.equal) continue;
    reduced_.noalias() -= block.cross.transpose() * block.inverse * block.cross;
    right_.noalias() -= block.cross.transpose() * (block.inverse * block.gradient);
  }
  return true;
}

LmStep KnownStructureProblem::solve(double damping) {
  if (!eliminate(damping)) return {};
  const Eigen::LLT<Eigen::MatrixXd> llt(reduced_);
  if (constraints_.equal && llt.info() != Eigen::Success) return {};
  shared_step_ = constraints_.equal ? Eigen::VectorXd(-llt.solve(right_)) : Eigen::VectorXd();
  double along = 0, damped = 0;
  for (size_t j = 0; j < blocks_.size(); ++j) {
    const Block& block = blocks_[j];
    Eigen::VectorXd right = block.gradient;
    if (constraints_.equal) right += block.cross * shared_step_;
    steps_[j] = -block.inverse * right;
    along += block.gradient.dot(steps_[j]);
    damped += damping * block.u.diagonal().dot(steps_[j].cwiseAbs2());
    if (!steps_[j].allFinite()) return {};
  }
  if (constraints_.equal) {
    along += shared_gradient_.dot(shared_step_);
    damped += damping * shared_.diagonal().dot(shared_step_.cwiseAbs2());
  }
  const double decrease = 0.5 * (damped - along);
  return {decrease > 0 && std::isfinite(decrease), decrease};
}

LmTrial KnownStructureProblem::evaluate(bool linearize) {
  const int own = static_cast<int>(basis_.cols());
  for (int j = 0; j < index_.image_count(); ++j) {
    trial_.scene.cam_from_world[j] = retract(state_.scene.cam_from_world[j], steps_[j].head<6>());
    const LensVector change =
        basis_ * (constraints_.equal ? shared_step_.head(own) : steps_[j].segment(6, own));
    trial_.scene.lenses[j] = Lens::from_vector(state_.scene.lenses[j].vector() + change);
  }
  if (constraints_.equal) {
    trial_.distortion = {state_.distortion.k1 + shared_step_[own],
                         state_.distortion.k2 + shared_step_[own + 1]};
  }
  trial_cost_ = cost(trial_);
  const bool there = linearize && trial_cost_ <= cost_;
  if (there) normal_equations(trial_);
  return {cost_, trial_cost_, there};
}

void KnownStructureProblem::accept() {
  std::swap(state_, trial_);
  cost_ = trial_cost_;
}

Eigen::MatrixXd KnownStructureProblem::lens_covariance(int image) {
  if (!eliminate(0)) return {};
  if (!constraints_.equal) return blocks_[image].inverse.block(6, 6, free_, free_);
  const Eigen::LLT<Eigen::MatrixXd> llt(reduced_);
  if (llt.info() != Eigen::Success) return {};
  return llt.solve(Eigen::MatrixXd::Identity(free_, free_));
}

}  // namespace raysfm
