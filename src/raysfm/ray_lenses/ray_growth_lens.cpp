// The lens of a reconstruction along rays: a guess, made better by what the residuals say.
#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "raysfm/calibration/calibration_evidence.h"
#include "raysfm/camera/model_check.h"
#include "raysfm/ray_lenses/ray_growth.h"

namespace raysfm {
namespace {

using Kind = RigParameters::Kind;

// How far off the guess may be: a coefficient of the model by what moves the rim of the image by this part;
// pixels are taken to be square.
constexpr double kGuessedFocal = 0.3, kSquare = 1e-5, kGuessedRim = 0.1;

}  // namespace

Eigen::Vector3d RayGrowth::direction_of_rim() const {
  int farthest = -1;
  for (int k = 0; k < tracks_.size(); ++k) {
    if (has_ray_[k] && (farthest < 0 || ray_[k].z() < ray_[farthest].z())) farthest = k;
  }
  return farthest < 0 ? Eigen::Vector3d::UnitX() : ray_[farthest];
}

// Part of its distance from the centre by which a unit of a parameter moves the pixel of a ray.
double RayGrowth::effect_on_rim(int parameter, const Eigen::Vector3d& rim) const {
  Eigen::VectorXd moved = values_;
  moved[parameter] += parameters_[parameter].step;
  Eigen::Vector2d centre, before, after;
  const Camera& camera = parameters_.given().cameras[0];
  if (!camera.project(Eigen::Vector3d::UnitZ(), &centre) || !camera.project(rim, &before) ||
      !parameters_.rig(moved).cameras[0].project(rim, &after))
    return 1;
  return (after - before).norm() / (before - centre).norm() / parameters_[parameter].step;
}

Eigen::VectorXd RayGrowth::guess_sigma() const {
  const CalibrationPrior guess{.focal = kGuessedFocal, .aspect = kSquare, .centre = options_.centre_sigma};
  const RigParameters wide(parameters_.given(), 1, guess);
  const Eigen::Vector3d rim = direction_of_rim();
  Eigen::VectorXd sigma(parameters_.size());
  for (int i = 0; i < parameters_.size(); ++i) {
    const bool is_coefficient = parameters_[i].kind == Kind::kNumber && parameters_.name(i)[0] != 'c';
    sigma[i] = is_coefficient ? kGuessedRim / effect_on_rim(i, rim) : wide[i].prior_sigma;
  }
  return sigma;
}

// Takes another lens over, where it is one, and what agrees with the present one is seen by it.
bool RayGrowth::try_lens(const Eigen::VectorXd& values) {
  const Camera camera = parameters_.rig(values).cameras[0];
  if (find_problem(camera.model)) return false;
  for (int k = 0; k < tracks_.size(); ++k) {
    Ray ray;
    if (r_.inlier[k] && !camera.ray(tracks_.pixel[k], &ray)) return false;
  }
  values_ = values;
  r_.camera = camera;
  return true;
}

// To the lens that guess and residuals make likeliest. Returns how far that is, in standard deviations of
// what both tell, as if no error were like another.
double RayGrowth::step_lens() {
  constexpr int kHalvings = 5;
  if (options_.is_known) return 0;
  RayProblemPart part = this->part();
  const auto evidence = measure_calibration(part.problem(), {.loss = kRayLoss}, parameters_, values_);
  if (!evidence) return 0;
  const double variance = evidence->cost / std::max(1, evidence->observations);
  const Eigen::VectorXd guess = variance * sigma_.cwiseAbs2().cwiseInverse();
  Eigen::MatrixXd information = evidence->information;
  information.diagonal() += guess;
  const auto unit = sigma_.asDiagonal();
  const Eigen::MatrixXd scaled = unit * information * unit;
  const Eigen::VectorXd right = -(unit * (evidence->gradient + guess.cwiseProduct(values_)));
  Eigen::VectorXd step = scaled.ldlt().solve(right);
  for (int h = 0; h < kHalvings; ++h, step *= 0.5) {
    if (try_lens(values_ + unit * step)) return std::sqrt(step.dot(scaled * step) / variance);
  }
  return 0;
}

void RayGrowth::take_sigma() {
  if (options_.is_known) return;
  RayProblemPart part = this->part();
  const auto evidence = measure_calibration(part.problem(), {.loss = kRayLoss}, parameters_, values_);
  if (!evidence) return;
  const CalibrationEvidence& e = *evidence;
  const auto unit = sigma_.asDiagonal();
  const double variance = e.cost / std::max(1, e.observations);
  const Eigen::MatrixXd information = unit * e.information * unit;
  const Eigen::MatrixXd identity = Eigen::MatrixXd::Identity(information.rows(), information.cols());
  const Eigen::MatrixXd inverse = (information + variance * identity).inverse();
  const Eigen::MatrixXd scatter = unit * e.scatter * unit + variance * information;
  const Eigen::VectorXd sigma = unit * (inverse * scatter * inverse).diagonal().cwiseSqrt();
  CalibrationPrior& s = r_.sigma;
  s.focal = s.centre = s.rim = 0;
  const CalibrationPrior usual;
  for (int i = 0; i < parameters_.size(); ++i) {
    const bool is_centre = parameters_[i].kind == Kind::kNumber && parameters_.name(i)[0] == 'c';
    if (parameters_[i].kind == Kind::kFocal) {
      s.focal = sigma[i];
    } else if (is_centre) {
      s.centre = std::max(s.centre, sigma[i] / r_.camera.longer_side());
    } else if (parameters_[i].kind == Kind::kNumber) {
      r_.strain = std::max(r_.strain, std::abs(values_[i]) / sigma_[i]);
      s.rim = std::max(s.rim, usual.rim * sigma[i] / parameters_[i].prior_sigma);
    }
  }
}

}  // namespace raysfm
