#include "raysfm/lenses/standard_problem.h"

#include <Eigen/Cholesky>
#include <atomic>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>

namespace raysfm {
namespace {

using Matrix25d = Eigen::Matrix<double, 2, 5>;

constexpr double kSlowGain = 0.5;  // what is left of the cost

// d pixel / d lens.
Matrix25d by_lens(double x, double y) {
  Matrix25d j;
  j << x, 0, 1, 0, y, 0, y, 0, 1, 0;
  return j;
}

}  // namespace

StandardProblem::StandardProblem(const ObservationIndex& index, const LensAdjustmentOptions& options,
                                 UncalibratedScene scene, LensRole role)
    : index_(index),
      options_(options),
      role_(role),
      expected_(expected_lens(options.constraints)),
      scene_(std::move(scene)),
      trial_(scene_),
      radial_(options.radial),
      trial_radial_(radial_),
      image_costs_(index.image_count()),
      lens_terms_(index.image_count()),
      team_(options.threads) {
  const Eigen::MatrixXd basis = lens_basis(options.constraints);
  free_ = static_cast<int>(basis.cols());
  basis_.leftCols(free_) = basis;
  numbers_ = free_ + (shared() && role == LensRole::kUnknown ? options.radial_terms : 0);
  block_ = shared() ? 6 : 6 + free_;
  elimination_.set_structure(index_.image_count(), block_, shared() ? numbers_ : 0, index_.point_begin,
                             index_.image_of_slot);
  in_view_.resize(index_.size());
  damping_scale_.resize(elimination_.rows());
  steps_.setZero(elimination_.rows());
  costs_.reserve(options.lm.max_iterations + 1);
  group_images();
  cost_ = start_cost();
}

// A hundred thousand times what the observations say of a principal point: the lenses of a group differ by
// that part of what each image says by itself.
void StandardProblem::group_images() {
  constexpr double kTight = 1e5;
  if (shared() || role_ != LensRole::kUnknown || options_.lens_of_image.empty()) return;
  std::map<int, std::vector<int>> groups;
  for (int j = 0; j < index_.image_count(); ++j)
    groups[options_.lens_of_image[index_.images[j]]].push_back(j);
  for (auto& [number, images] : groups) {
    if (images.size() > 1) groups_.push_back(std::move(images));
  }
  sharing_weight_ = kTight * index_.size() / std::max(1, index_.image_count());
}

LensVector StandardProblem::mean_lens(const std::vector<int>& group, const UncalibratedScene& scene) const {
  LensVector mean = LensVector::Zero();
  for (const int j : group) mean += scene.lenses[j].vector() / static_cast<double>(group.size());
  return mean;
}

double StandardProblem::sharing_cost(const UncalibratedScene& scene) const {
  double sum = 0;
  for (const std::vector<int>& group : groups_) {
    const LensVector mean = mean_lens(group, scene);
    for (const int j : group) sum += sharing_weight_ * (scene.lenses[j].vector() - mean).squaredNorm();
  }
  return sum;
}

// Of the numbers of the lenses of a group, all with all: each is held about their mean.
void StandardProblem::add_sharing(const UncalibratedScene& scene) {
  const Matrix5d normal = sharing_weight_ * (basis_.transpose() * basis_);
  for (const std::vector<int>& group : groups_) {
    const LensVector mean = mean_lens(group, scene);
    const double share = 1.0 / static_cast<double>(group.size());
    for (const int j : group) {
      const LensVector gradient = sharing_weight_ * (basis_.transpose() * (scene.lenses[j].vector() - mean));
      elimination_.gradient().segment(lens_rows(j), free_) += gradient.head(free_);
      for (const int other : group) {
        if (other > j) continue;
        elimination_.u().block(lens_rows(j), lens_rows(other), free_, free_) +=
            ((other == j ? 1.0 : 0.0) - share) * normal.topLeftCorner(free_, free_);
      }
    }
  }
}

double StandardProblem::start_cost() {
  const double given = cost(&scene_, radial_);
  if (role_ == LensRole::kUnknown || !std::isfinite(given)) return given;
  trial_.lenses = scene_.lenses;
  fitting_ = true;
  const double fitted = cost(&trial_, radial_);
  fitting_ = fitted > kSlowGain * given && std::isfinite(fitted);
  if (!fitting_) return given;
  scene_.lenses = trial_.lenses;
  return fitted;
}

bool StandardProblem::project_image(int j, const UncalibratedScene& scene) {
  constexpr double kMinCosine = 1e-6;
  const Eigen::Matrix3d rotation = scene.cam_from_world[j].rotation.toRotationMatrix();
  const Eigen::Vector3d translation = scene.cam_from_world[j].translation;
  for (int o = index_.image_begin[j]; o < index_.image_begin[j + 1]; ++o) {
    const Eigen::Vector3d x = rotation * scene.points[index_.point_of[o]] + translation;
    if (!(x.z() > 0 && x.z() * x.z() > kMinCosine * kMinCosine * x.squaredNorm())) return false;
    const double depth = 1 / x.z();
    in_view_[o] = {depth * x.x(), depth * x.y(), depth};
  }
  return true;
}

bool StandardProblem::project(const UncalibratedScene& scene) {
  std::atomic<bool> in_front = true;
  team_.run(index_.image_count(), [&](int j) {
    if (!project_image(j, scene)) in_front.store(false, std::memory_order_relaxed);
  });
  return in_front;
}

// The change of the free numbers that brings the cost to its least, for points where they project.
void StandardProblem::fit_lenses(UncalibratedScene* scene) const {
  Matrix5d normal = Matrix5d::Zero();
  LensVector right = LensVector::Zero();
  for (int j = 0; j < index_.image_count(); ++j) {
    const Lens& lens = scene->lenses[j];
    for (int o = index_.image_begin[j]; o < index_.image_begin[j + 1]; ++o) {
      const Eigen::Vector2d m = in_view_[o].head<2>();
      const Matrix25d b = by_lens(m.x(), m.y());
      normal.noalias() += b.transpose() * (index_.weight[o] * b);
      right.noalias() += b.transpose() * (index_.weight[o] * (index_.pixel[o] - lens.pixel(m)));
    }
    if (shared() && j + 1 < index_.image_count()) continue;
    normal.diagonal() += expected_.weight;
    right += expected_.weight.cwiseProduct(expected_.mean - lens.vector());
    // What is not free has no column: it keeps its place by a pivot of one.
    Matrix5d reduced = basis_.transpose() * normal * basis_;
    for (int k = free_; k < 5; ++k) reduced(k, k) = 1;
    const LensVector change = basis_ * reduced.ldlt().solve(basis_.transpose() * right);
    for (int k = shared() ? 0 : j; k <= j; ++k) {
      scene->lenses[k] = Lens::from_vector(scene->lenses[k].vector() + change);
    }
    normal.setZero();
    right.setZero();
  }
}

RadialDistortion StandardProblem::moved(const RadialDistortion& radial, const Eigen::VectorXd& steps) const {
  const int first = lens_rows(0) + free_;
  RadialDistortion result = radial;
  if (numbers_ > free_) result.k1 += steps[first];
  if (numbers_ > free_ + 1) result.k2 += steps[first + 1];
  return result;
}

Eigen::Vector2d StandardProblem::predicted(const Lens& lens, int observation,
                                           const RadialDistortion& radial) const {
  const Eigen::Vector2d m = in_view_[observation].head<2>();
  return lens.pixel(radial.none() ? m : radial(m));
}

double StandardProblem::image_cost(int j, const Lens& lens, const RadialDistortion& radial) const {
  double sum = 0;
  for (int o = index_.image_begin[j]; o < index_.image_begin[j + 1]; ++o) {
    sum += index_.weight[o] * (predicted(lens, o, radial) - index_.pixel[o]).squaredNorm();
  }
  return sum;
}

double StandardProblem::cost(UncalibratedScene* scene, const RadialDistortion& radial) {
  constexpr double kNever = std::numeric_limits<double>::infinity();
  if (!project(*scene)) return kNever;
  if (fitting_) fit_lenses(scene);
  for (const Lens& lens : scene->lenses) {
    if (!(lens.fx > 0 && lens.fy > 0)) return kNever;
  }
  team_.run(index_.image_count(), [&](int j) { image_costs_[j] = image_cost(j, scene->lenses[j], radial); });
  double sum = std::accumulate(image_costs_.begin(), image_costs_.end(), 0.0);
  for (int j = 0; j < lens_count() && expected_.any(); ++j) {
    sum += expected_.weight.dot((scene->lenses[j].vector() - expected_.mean).cwiseAbs2());
  }
  return 0.5 * (sum + sharing_cost(*scene));
}

// Of the pixel of an observation, where the cost was taken last; what is not unknown has no column.
void StandardProblem::jacobians(const Lens& lens, int observation, Matrix26d* by_pose,
                                Matrix27d* by_numbers) const {
  const Eigen::Vector2d m = in_view_[observation].head<2>();
  const double depth = in_view_[observation].z();
  const Eigen::Matrix2d root = lens.matrix().topLeftCorner<2, 2>();
  Eigen::Matrix<double, 2, 3> by_ray;  // of the point in the camera, times its z
  Eigen::Vector2d seen = m;
  by_numbers->setZero();
  if (radial_.none() && numbers_ == free_) {
    by_ray << root, -root * m;
  } else {
    const Eigen::Matrix2d bent = root * radial_.jacobian(m);
    by_ray << bent, -bent * m;
    seen = radial_(m);
    const double r2 = m.squaredNorm();
    if (numbers_ > free_) by_numbers->col(free_) = r2 * root * m;
    if (numbers_ > free_ + 1) by_numbers->col(free_ + 1) = r2 * r2 * root * m;
  }
  by_pose->leftCols<3>() = depth * by_ray;
  for (int k = 0; k < 2; ++k) {
    const double a = by_ray(k, 0), b = by_ray(k, 1), c = by_ray(k, 2);
    (*by_pose)(k, 3) = m.y() * c - b;
    (*by_pose)(k, 4) = a - m.x() * c;
    (*by_pose)(k, 5) = m.x() * b - m.y() * a;
  }
  by_numbers->leftCols(free_) = by_lens(seen.x(), seen.y()) * basis_.leftCols(free_);
}

// What an observation adds to the sums of its point: derivatives by the point, of x and of y; its residual
// times its weight; its weight; derivatives by the numbers of the lens, of x and of y.
using PointTerms = Eigen::Map<Eigen::Matrix<double, 23, 1>>;
static_assert(PointTerms::SizeAtCompileTime <= PointElimination::kRoom);

// One row of a Jacobian: the pose's six columns, then those of the numbers of the lens; the rest is zero.
using JacobianRow = Eigen::Matrix<double, kJacobianRow, 1>;

void StandardProblem::linearize_image(int j, const UncalibratedScene& scene) {
  using Matrix23d = Eigen::Matrix<double, 2, 3>;
  const Eigen::Matrix3d rotation = scene.cam_from_world[j].rotation.toRotationMatrix();
  const Lens& lens = scene.lenses[j];
  const int columns = 6 + numbers_;
  Eigen::Matrix<double, kJacobianRow, 13> u;  // its lower triangle
  u.setZero();
  JacobianRow gradient = JacobianRow::Zero();
  for (int o = index_.image_begin[j]; o < index_.image_begin[j + 1]; ++o) {
    const double w = index_.weight[o];
    const Eigen::Vector2d r = w * (predicted(lens, o, radial_) - index_.pixel[o]);
    Matrix26d j_pose;
    Matrix27d j_lens;
    jacobians(lens, o, &j_pose, &j_lens);
    const Matrix23d j_point = j_pose.leftCols<3>() * rotation, weighted_point = w * j_point;
    JacobianRow by_x, by_y;
    by_x << j_pose.row(0).transpose(), j_lens.row(0).transpose(), 0, 0, 0;
    by_y << j_pose.row(1).transpose(), j_lens.row(1).transpose(), 0, 0, 0;

    add_outer_products(by_x.data(), by_y.data(), w, columns, u.data());
    gradient += by_x * r.x() + by_y * r.y();
    PointElimination::Cross cross = elimination_.w(index_.slot_of[o]);
    for (int k = 0; k < 3; ++k) {
      const JacobianRow column = by_x * weighted_point(0, k) + by_y * weighted_point(1, k);
      if (shared()) {
        cross.col(k) = column.head<6>();
      } else {
        cross.col(k) = column.head(columns);
      }
    }
    PointTerms(elimination_.room(index_.slot_of[o])) << j_point.row(0).transpose(),
        j_point.row(1).transpose(), r, w, j_lens.row(0).transpose(), j_lens.row(1).transpose();
  }
  const int first = block_ * j;
  elimination_.u().block<6, 6>(first, first) = u.topLeftCorner<6, 6>();
  elimination_.u().block(lens_rows(j), first, numbers_, 6) = u.block(6, 0, numbers_, 6);
  elimination_.gradient().segment<6>(first) = gradient.head<6>();
  lens_terms_[j] << u.block<7, 7>(6, 6), gradient.segment<7>(6);
}

// The terms of all that see a point.
void StandardProblem::sum_point(int point) {
  Eigen::Matrix3d v = Eigen::Matrix3d::Zero();
  Eigen::Vector3d gradient = Eigen::Vector3d::Zero();
  Eigen::Matrix<double, 7, 3> by_lens = Eigen::Matrix<double, 7, 3>::Zero();
  for (int slot = index_.point_begin[point]; slot < index_.point_begin[point + 1]; ++slot) {
    const PointTerms terms(elimination_.room(slot));
    const Eigen::Map<const Eigen::Matrix<double, 2, 3, Eigen::RowMajor>> j_point(terms.data());
    const Eigen::Matrix<double, 2, 3> weighted_point = terms[8] * j_point;
    v.noalias() += j_point.transpose() * weighted_point;
    gradient.noalias() += j_point.transpose() * terms.segment<2>(6);
    if (!shared()) continue;
    by_lens.noalias() += terms.segment<7>(9) * weighted_point.row(0);
    by_lens.noalias() += terms.segment<7>(16) * weighted_point.row(1);
  }
  elimination_.v(point) = v;
  elimination_.point_gradient(point) = gradient;
  if (shared()) elimination_.shared_w(point) = by_lens.topRows(numbers_);
}

void StandardProblem::add_priors(const UncalibratedScene& scene) {
  const Matrix5d normal = basis_.transpose() * expected_.weight.asDiagonal() * basis_;
  for (int j = 0; j < lens_count(); ++j) {
    const LensVector off = scene.lenses[j].vector() - expected_.mean;
    const LensVector gradient = basis_.transpose() * expected_.weight.cwiseProduct(off);
    const int first = lens_rows(j);
    elimination_.u().block(first, first, free_, free_) += normal.topLeftCorner(free_, free_);
    elimination_.gradient().segment(first, free_) += gradient.head(free_);
  }
}

void StandardProblem::normal_equations(const UncalibratedScene& scene) {
  elimination_.set_zero();
  team_.run(index_.image_count(), [&](int j) { linearize_image(j, scene); });
  team_.run(elimination_.batches(), [&](int batch) {
    for (int i = elimination_.first_point(batch); i < elimination_.first_point(batch + 1); ++i) sum_point(i);
  });
  for (int j = 0; j < index_.image_count(); ++j) {
    const int first = lens_rows(j);
    elimination_.u().block(first, first, numbers_, numbers_) +=
        lens_terms_[j].topLeftCorner(numbers_, numbers_);
    elimination_.gradient().segment(first, numbers_) += lens_terms_[j].col(7).head(numbers_);
  }
  if (expected_.any()) add_priors(scene);
  damping_scale_ = elimination_.u().diagonal();
  add_sharing(scene);  // together they move freely
  if (role_ == LensRole::kUnknown) return;
  for (int j = 0; j < lens_count(); ++j) damping_scale_.segment(lens_rows(j), free_).setZero();
}

double StandardProblem::linearize() {
  cost_ = cost(&scene_, radial_);
  if (std::isfinite(cost_)) normal_equations(scene_);
  if (costs_.empty()) costs_.push_back(cost_);
  return cost_;
}

// The factor takes the place of the reduced system.
bool StandardProblem::factorize(double damping) {
  if (!elimination_.reduce(damping, team_)) return false;
  elimination_.reduced().diagonal() += damping * damping_scale_;
  return elimination_.factorize();
}

LmStep StandardProblem::solve(double damping) {
  costs_.push_back(costs_.back());
  if (!factorize(damping)) return {};
  steps_ = -elimination_.right();
  elimination_.reduced().triangularView<Eigen::Lower>().solveInPlace(steps_);
  elimination_.reduced().triangularView<Eigen::Lower>().transpose().solveInPlace(steps_);
  elimination_.substitute(steps_, team_);
  const double along = elimination_.gradient_along_step() + elimination_.gradient().dot(steps_);
  const double damped = damping * (elimination_.scaled_step_norm() + damping_scale_.dot(steps_.cwiseAbs2()));
  const double decrease = 0.5 * (damped - along);
  return {steps_.allFinite() && decrease > 0, decrease};
}

LmTrial StandardProblem::evaluate(bool linearize) {
  for (int j = 0; j < index_.image_count(); ++j) {
    trial_.cam_from_world[j] = retract(scene_.cam_from_world[j], steps_.segment<6>(block_ * j));
    const LensVector change = basis_.leftCols(free_) * steps_.segment(lens_rows(j), free_);
    trial_.lenses[j] = Lens::from_vector(scene_.lenses[j].vector() + change);
  }
  for (int i = 0; i < index_.point_count(); ++i)
    trial_.points[i] = scene_.points[i] + elimination_.point_step(i);
  trial_radial_ = moved(radial_, steps_);
  trial_cost_ = cost(&trial_, trial_radial_);
  const bool there = linearize && trial_cost_ <= cost_;
  if (there) {
    std::swap(radial_, trial_radial_);
    normal_equations(trial_);
    std::swap(radial_, trial_radial_);
  }
  return {cost_, trial_cost_, there};
}

void StandardProblem::accept() {
  fitting_ = fitting_ || (role_ == LensRole::kDependent && trial_cost_ > kSlowGain * cost_);
  std::swap(scene_, trial_);
  radial_ = trial_radial_;
  cost_ = trial_cost_;
  costs_.back() = cost_;
}

Eigen::VectorXd StandardProblem::step() const {
  Eigen::VectorXd all(steps_.size() + 3 * index_.point_count());
  all.head(steps_.size()) = steps_;
  for (int i = 0; i < index_.point_count(); ++i) {
    all.segment<3>(steps_.size() + 3 * i) = elimination_.point_step(i);
  }
  return all;
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
    covariances.push_back(basis_.leftCols(free_) * (columns.transpose() * columns) *
                          basis_.leftCols(free_).transpose());
  }
  return covariances;
}

Eigen::Matrix<double, 7, Eigen::Dynamic> StandardProblem::influences() {
  constexpr double kDamping = 1e-10;  // as above
  Eigen::Matrix<double, 7, Eigen::Dynamic> result(7, shared() ? index_.point_count() : 0);
  if (result.cols() == 0 || !factorize(kDamping)) return {7, 0};
  Eigen::MatrixXd answers = Eigen::MatrixXd::Zero(elimination_.rows(), numbers_);
  answers.bottomRows(numbers_).setIdentity();
  elimination_.reduced().triangularView<Eigen::Lower>().solveInPlace(answers);
  elimination_.reduced().triangularView<Eigen::Lower>().transpose().solveInPlace(answers);
  Eigen::MatrixXd moves = Eigen::MatrixXd::Zero(numbers_, index_.point_count());
  std::vector<Eigen::Vector3d> at_rest(index_.point_count());
  elimination_.substitute(Eigen::VectorXd::Zero(elimination_.rows()), team_);
  for (int i = 0; i < index_.point_count(); ++i) at_rest[i] = elimination_.point_step(i);
  for (int number = 0; number < numbers_; ++number) {
    const Eigen::VectorXd answer = answers.col(number);
    elimination_.substitute(answer, team_);
    for (int j = 0; j < index_.image_count(); ++j) {
      const Eigen::Matrix3d rotation = scene_.cam_from_world[j].rotation.toRotationMatrix();
      for (int o = index_.image_begin[j]; o < index_.image_begin[j + 1]; ++o) {
        const int point = index_.point_of[o];
        Matrix26d j_pose;
        Matrix27d j_lens;
        jacobians(scene_.lenses[j], o, &j_pose, &j_lens);
        const Eigen::Vector3d point_answer = elimination_.point_step(point) - at_rest[point];
        const Eigen::Vector2d change = j_pose * answer.segment<6>(block_ * j) +
                                       j_lens.leftCols(numbers_) * answer.tail(numbers_) +
                                       j_pose.leftCols<3>() * (rotation * point_answer);
        const Eigen::Vector2d r = predicted(scene_.lenses[j], o, radial_) - index_.pixel[o];
        moves(number, point) -= index_.weight[o] * r.dot(change);
      }
    }
  }
  result.setZero();
  result.topRows<5>() = basis_.leftCols(free_) * moves.topRows(free_);
  result.middleRows(5, numbers_ - free_) = moves.bottomRows(numbers_ - free_);
  return result;
}

}  // namespace raysfm
