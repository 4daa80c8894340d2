#include <Eigen/Cholesky>
#include <cmath>
#include <limits>

#include "raysfm/geometry/pose.h"
#include "raysfm/lenses/intrinsics_free.h"

namespace raysfm {
namespace {

using Matrix26d = Eigen::Matrix<double, 2, 6>;
using Matrix5x6d = Eigen::Matrix<double, 5, 6>;

constexpr int kBlock = 12;  // 6 numbers of a pose, then 6 of f

const Matrix5x6d kC = factor_change_from_averages();

// q moves by -P phi.
Eigen::Matrix<double, 2, 5> by_factor_change(const Eigen::Vector2d& q) {
  return (Eigen::Matrix<double, 2, 5>() << q.x(), q.y(), 1, 0, 0, 0, 0, 0, q.y(), 1).finished();
}

// Lambda of an image whose residual has the metric G: sum w |e - P phi|^2_G = sum w |e|^2_G + f^T Lambda f.
Matrix6d lambda_of_image(const Eigen::Matrix2d& g, double weight) {
  Matrix5x6d b;                       // sum w P^T G e = weight * b f
  b << g(0, 0), 0, 0, g(0, 1), 0, 0,  //
      0, g(0, 0), 0, 0, g(0, 1), 0,   //
      0, 0, g(0, 0), 0, 0, g(0, 1),   //
      0, g(1, 0), 0, 0, g(1, 1), 0,   //
      0, 0, g(1, 0), 0, 0, g(1, 1);
  Eigen::Matrix<double, 5, 5> d = Eigen::Matrix<double, 5, 5>::Zero();  // sum w P^T G P = weight * d
  d.topLeftCorner<3, 3>().diagonal().setConstant(g(0, 0));
  d.bottomRightCorner<2, 2>().diagonal().setConstant(g(1, 1));
  d(1, 3) = d(2, 4) = d(3, 1) = d(4, 2) = g(0, 1);
  const Matrix6d cross = kC.transpose() * b;
  return weight * (kC.transpose() * d * kC - cross - cross.transpose());
}

}  // namespace

IntrinsicsFreeProblem::IntrinsicsFreeProblem(const ObservationIndex& index,
                                             const LensAdjustmentOptions& options, UncalibratedScene scene)
    : index_(index),
      options_(options),
      scene_(std::move(scene)),
      trial_(scene_),
      weight_(index.weight),
      team_(options.threads) {
  const int images = index_.image_count();
  images_.resize(images);
  in_camera_.resize(index_.size());
  invariant_.resize(index_.size());
  valid_ = measure_moments();
  if (!valid_) return;
  std::vector<MomentInformation> information(images);
  for (int j = 0; j < images && valid_; ++j) {
    valid_ = project_image(j, scene_);
    const Image& image = images_[j];
    information[j] = {image.weight, image.t_p.d, image.t_p.d / image.t_m.d};
  }
  if (!valid_) return;
  const bool multipliers = options.method == ConstraintMethod::kLagrange;
  rows_ = constraint_rows(options.constraints, information, options.constraint_weight, multipliers);
  elimination_.set_structure(images, kBlock, 0, index_.point_begin, index_.image_of_slot);
  pose_scale_.resize(6 * images);
  gamma_.resize(6 * images);
  row_coefficients_.resize(12, rows_.size());
}

bool IntrinsicsFreeProblem::measure_moments() {
  for (int j = 0; j < index_.image_count(); ++j) {
    Moments moments;
    for (int o = index_.image_begin[j]; o < index_.image_begin[j + 1]; ++o)
      moments.add(index_.pixel[o], weight_[o]);
    if (!moments.factor(&images_[j].t_p)) return false;
    images_[j].t_p_inverse = images_[j].t_p.inverse();
    images_[j].weight = moments.weight;
  }
  return true;
}

bool IntrinsicsFreeProblem::project_image(int j, const UncalibratedScene& scene) {
  constexpr double kMinCosine = 1e-6;
  const Eigen::Matrix3d rotation = scene.cam_from_world[j].rotation.toRotationMatrix();
  const Eigen::Vector3d translation = scene.cam_from_world[j].translation;
  Moments moments;
  for (int o = index_.image_begin[j]; o < index_.image_begin[j + 1]; ++o) {
    const Eigen::Vector3d x = rotation * scene.points[index_.point_of[o]] + translation;
    if (!(x.z() > kMinCosine * x.norm())) return false;
    in_camera_[o] = x;
    invariant_[o] = x.head<2>() / x.z();
    moments.add(invariant_[o], weight_[o]);
  }
  Image& image = images_[j];
  if (!moments.factor(&image.t_m)) return false;
  image.t_m_inverse = image.t_m.inverse();
  for (int o = index_.image_begin[j]; o < index_.image_begin[j + 1]; ++o) {
    invariant_[o] = image.t_m_inverse * invariant_[o];
  }
  return true;
}

Eigen::Matrix2d IntrinsicsFreeProblem::metric_root(int j) const {
  if (options_.space == CostSpace::kInvariant) return Eigen::Matrix2d::Identity();
  return images_[j].t_p.linear();
}

Eigen::Vector2d IntrinsicsFreeProblem::residual(int j, int o) const {
  if (options_.space == CostSpace::kInvariant)
    return invariant_[o] - images_[j].t_p_inverse * index_.pixel[o];
  return images_[j].t_p * invariant_[o] - index_.pixel[o];
}

double IntrinsicsFreeProblem::image_cost(int j) const {
  double sum = 0;
  for (int o = index_.image_begin[j]; o < index_.image_begin[j + 1]; ++o) {
    sum += weight_[o] * residual(j, o).squaredNorm();
  }
  return 0.5 * sum;
}

double IntrinsicsFreeProblem::cost(UncalibratedScene* scene) {
  double sum = 0;
  for (int j = 0; j < index_.image_count(); ++j) {
    if (!project_image(j, *scene)) return std::numeric_limits<double>::infinity();
    scene->lenses[j] = (images_[j].t_p * images_[j].t_m_inverse).lens();
    sum += image_cost(j);
  }
  violations(rows_, scene->lenses, &trial_violations_);
  for (size_t i = 0; i < rows_.size(); ++i) {
    const double r = rows_[i].weight * trial_violations_[i];
    sum += 0.5 * r * r;
  }
  return sum;
}

void IntrinsicsFreeProblem::linearize_image(int j, const UncalibratedScene& scene) {
  Image& image = images_[j];
  const Eigen::Matrix3d rotation = scene.cam_from_world[j].rotation.toRotationMatrix();
  const Eigen::Matrix2d root = metric_root(j), t = image.t_m_inverse.linear();
  Matrix6d u = Matrix6d::Zero(), averages = Matrix6d::Zero();
  Vector6d gradient = Vector6d::Zero();
  FactorChange by_factor = FactorChange::Zero();
  for (int o = index_.image_begin[j]; o < index_.image_begin[j + 1]; ++o) {
    const int point = index_.point_of[o];
    const Eigen::Vector3d& x = in_camera_[o];
    const Eigen::Vector2d& q = invariant_[o];
    const double w = weight_[o], share = w / image.weight, depth = 1 / x.z();
    Eigen::Matrix<double, 2, 3> e;
    e.leftCols<2>() = depth * t;
    e.col(2) = -depth * depth * (t * x.head<2>());
    Matrix26d e_pose;
    e_pose.leftCols<3>() = e;
    for (int r = 0; r < 2; ++r) e_pose.row(r).tail<3>() = x.cross(e.row(r).transpose()).transpose();
    const Eigen::Matrix<double, 2, 3> e_point = e * rotation;
    const Matrix26d j_pose = root * e_pose;
    const Eigen::Matrix<double, 2, 3> j_point = root * e_point;
    const Eigen::Vector2d r = residual(j, o);

    u.noalias() += w * (j_pose.transpose() * j_pose);
    gradient.noalias() += w * (j_pose.transpose() * r);
    elimination_.v(point).noalias() += w * (j_point.transpose() * j_point);
    elimination_.point_gradient(point).noalias() += w * (j_point.transpose() * r);
    PointElimination::Cross cross = elimination_.w(index_.slot_of[o]);
    cross.topRows<6>().noalias() = w * (j_pose.transpose() * j_point);
    const double factors[3] = {share * q.x(), share * q.y(), share};
    for (int k = 0; k < 6; ++k) {
      cross.row(6 + k) = factors[k % 3] * e_point.row(k / 3);
      averages.row(k) += factors[k % 3] * e_pose.row(k / 3);
    }
    by_factor.noalias() += w * (by_factor_change(q).transpose() * (root.transpose() * r));
  }
  elimination_.u().block<6, 6>(kBlock * j, kBlock * j) = u;
  elimination_.u().block<6, 6>(kBlock * j + 6, kBlock * j) = averages;
  elimination_.gradient().segment<6>(kBlock * j) = gradient;
  pose_scale_.segment<6>(6 * j) = u.diagonal();
  image.own_lambda = lambda_of_image(root.transpose() * root, image.weight);
  image.lens_by_factor = lens_by_factor_change(image.t_p, image.t_m_inverse);
  gamma_.segment<6>(6 * j) = -kC.transpose() * by_factor;
}

void IntrinsicsFreeProblem::add_constraints(const UncalibratedScene& scene) {
  const bool multipliers = options_.method == ConstraintMethod::kLagrange;
  violations(rows_, scene.lenses, &violations_);
  for (size_t i = 0; i < rows_.size(); ++i) {
    const ConstraintRow& row = rows_[i];
    auto coefficients = row_coefficients_.col(i);
    coefficients.head<6>() =
        (row.coefficients.transpose() * images_[row.image].lens_by_factor * kC).transpose();
    coefficients.tail<6>().setZero();
    if (row.reference >= 0) {
      coefficients.tail<6>() =
          -(row.coefficients.transpose() * images_[row.reference].lens_by_factor * kC).transpose();
    }
    if (multipliers && row.exact) continue;
    // About a mean, the weighted violations have no sum for the mean to move.
    const double w = row.weight * row.weight * violations_[i];
    gamma_.segment<6>(6 * row.image) += w * coefficients.head<6>();
    if (row.reference >= 0) gamma_.segment<6>(6 * row.reference) += w * coefficients.tail<6>();
  }
}

void IntrinsicsFreeProblem::normal_equations(const UncalibratedScene& scene) {
  elimination_.set_zero();
  for (int j = 0; j < index_.image_count(); ++j) linearize_image(j, scene);
  add_constraints(scene);
}

double IntrinsicsFreeProblem::linearize() {
  cost_ = cost(&scene_);
  if (std::isfinite(cost_)) normal_equations(scene_);
  if (costs_.empty()) costs_.push_back(cost_);
  return cost_;
}

LmTrial IntrinsicsFreeProblem::evaluate(bool linearize) {
  for (int j = 0; j < index_.image_count(); ++j) {
    trial_.cam_from_world[j] = retract(scene_.cam_from_world[j], pose_steps_.segment<6>(6 * j));
  }
  for (int i = 0; i < index_.point_count(); ++i)
    trial_.points[i] = scene_.points[i] + elimination_.point_step(i);
  trial_cost_ = cost(&trial_);
  const bool there = linearize && trial_cost_ <= cost_;
  if (there) normal_equations(trial_);
  return {cost_, trial_cost_, there};
}

void IntrinsicsFreeProblem::accept() {
  std::swap(scene_, trial_);
  cost_ = trial_cost_;
  costs_.back() = cost_;
}

std::vector<double> IntrinsicsFreeProblem::residuals(UncalibratedScene* scene) {
  if (!std::isfinite(cost(scene))) return {};
  std::vector<double> values;
  for (int j = 0; j < index_.image_count(); ++j) {
    for (int o = index_.image_begin[j]; o < index_.image_begin[j + 1]; ++o) {
      const Eigen::Vector2d r = std::sqrt(weight_[o]) * residual(j, o);
      values.insert(values.end(), {r.x(), r.y()});
    }
  }
  for (size_t i = 0; i < rows_.size(); ++i) values.push_back(rows_[i].weight * trial_violations_[i]);
  return values;
}

}  // namespace raysfm
