#include "raysfm/robust/absolute_pose.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

#include "raysfm/robust/ransac.h"
#include "raysfm/solvers/generalised_p3p.h"

namespace raysfm {

using Eigen::Matrix3d;
using Eigen::Vector2d;
using Eigen::Vector3d;

namespace {

// Observations as rays in the rig's frame, as the loops of RANSAC want them.
struct RayTable {
  std::vector<int> observations;  // index into the input
  std::vector<Ray> rays;
  std::vector<Vector3d> points;
  std::vector<double> weights;  // (pixels per radian / (error of an inlier * sigma))^2 at the pixel

  int size() const { return static_cast<int>(points.size()); }
  void clear() { observations.clear(), rays.clear(), points.clear(), weights.clear(); }
  void add(int observation, const Ray& ray, const Vector3d& point, double weight) {
    if (!point.allFinite() || !ray.origin.allFinite() || !ray.direction.allFinite()) return;
    observations.push_back(observation);
    rays.push_back(ray);
    points.push_back(point);
    weights.push_back(weight);
  }
};

// Mean square over the directions of d pixel / d angle at a bearing; the whole camera's where the
// model cannot project.
double squared_pixels_per_radian(const Camera& camera, const Vector3d& bearing, double fallback) {
  Vector2d pixel;
  Eigen::Matrix<double, 2, 3> jacobian;
  if (!camera.project(bearing, &pixel, &jacobian)) return fallback;
  return 0.5 * jacobian.squaredNorm();
}

double squared_limit(const PoseObservations& observations, int i, double max_error) {
  const double limit = max_error * observations.sigma(i);
  return limit * limit;
}

void fill_from_pixels(const Rig& rig, const PoseObservations& observations, double max_error,
                      RayTable* table) {
  for (int c = 0; c < static_cast<int>(rig.cameras.size()); ++c) {
    const Camera& camera = rig.cameras[c];
    const double scale = camera.pixels_per_radian();
    for (int i = 0; i < observations.size(); ++i) {
      Ray ray;
      if (observations.camera(i) != c || !camera.ray(observations.pixels[i], &ray)) continue;
      const double squared = squared_pixels_per_radian(camera, ray.direction, scale * scale);
      const Ray in_rig{camera.rig_from_cam * ray.origin, camera.rig_from_cam.rotation * ray.direction};
      table->add(i, in_rig, observations.points_in_world[i],
                 squared / squared_limit(observations, i, max_error));
    }
  }
}

void fill(const Rig& rig, const PoseObservations& observations, double max_error, RayTable* table) {
  table->clear();
  if (observations.rays.empty()) return fill_from_pixels(rig, observations, max_error, table);
  for (int i = 0; i < observations.size(); ++i) {
    const ObservedRay& ray = observations.rays[i];
    const double squared = 0.5 * ray.tangents.squaredNorm();
    table->add(i, {ray.origin, ray.direction}, observations.points_in_world[i],
               squared / squared_limit(observations, i, max_error));
  }
}

// Hypotheses are scored over the whole rig by the angle weighted to pixels. A sample is three rays of any
// cameras, solved for, or the paper's five, adjusted from the last pose.
template <int kRays>
class PoseRansac {
 public:
  using Model = Rigid3;  // rig_from_world
  static constexpr int kSampleSize = kRays;
  static constexpr int kMaxModels = kRays == 3 ? kMaxGeneralisedP3pPoses : 1;

  // `prior` is used by samples of five.
  PoseRansac(const Rig& rig, const PoseObservations& observations, const RayTable& table, const Rigid3& prior)
      : rig_(rig), observations_(observations), table_(table), prior_(prior) {}

  int size() const { return table_.size(); }

  bool sample(Rng& rng, std::array<int, kRays>* sample) const {
    draw_sample(rng, size(), sample);
    return true;
  }

  int generate(const std::array<int, kRays>& sample, std::array<Rigid3, kMaxModels>* rig_from_world) {
    if constexpr (kRays == 3) {
      std::array<Ray, 3> rays;
      std::array<Vector3d, 3> points;
      for (int i = 0; i < 3; ++i) rays[i] = table_.rays[sample[i]], points[i] = table_.points[sample[i]];
      return generalised_p3p(rays, points, rig_from_world);
    } else {
      constexpr int kIterations = 20;
      std::array<int, kRays> observations;
      for (int i = 0; i < kRays; ++i) observations[i] = table_.observations[sample[i]];
      residuals_.load(rig_, observations_, observations);
      (*rig_from_world)[0] = prior_;
      minimise_pose(residuals_, {}, kIterations, &(*rig_from_world)[0]);
      return 1;
    }
  }

  RansacScore score(const Rigid3& rig_from_world, double limit) const {
    const Matrix3d r = rig_from_world.rotation.toRotationMatrix();
    return truncated_score(size(), limit, [&](int i) { return error(r, rig_from_world.translation, i); });
  }

  // A few iterations on at most kMaxPoints of the inliers, evenly spread.
  void refine(Rigid3* rig_from_world) {
    constexpr int kMaxPoints = 150, kIterations = 4;
    collect_inliers(*rig_from_world, &inliers_);
    thin_out(kMaxPoints, &inliers_);
    if (inliers_.size() < 4) return;
    residuals_.load(rig_, observations_, inliers_);
    minimise_pose(residuals_, {}, kIterations, rig_from_world);
  }

 private:
  // Squared tangent of the angle between ray and point, 1 at the limit of an inlier; 1 behind.
  double error(const Matrix3d& r, const Vector3d& t, int i) const {
    const Vector3d x = r * table_.points[i] + (t - table_.rays[i].origin);
    const double along = table_.rays[i].direction.dot(x);
    const double across2 = x.squaredNorm() - along * along;
    return along > 0 ? table_.weights[i] * across2 / (along * along) : 1.0;
  }

  void collect_inliers(const Rigid3& rig_from_world, std::vector<int>* inliers) const {
    const Matrix3d r = rig_from_world.rotation.toRotationMatrix();
    inliers->clear();
    for (int i = 0; i < size(); ++i) {
      if (error(r, rig_from_world.translation, i) < 1) inliers->push_back(table_.observations[i]);
    }
  }

  const Rig& rig_;
  const PoseObservations& observations_;
  const RayTable& table_;
  Rigid3 prior_;
  PoseResiduals residuals_;
  std::vector<int> inliers_;
};

template <int kRays>
RansacReport search(const Rig& rig, const PoseObservations& observations, const RayTable& table,
                    const Rigid3* prior, const PoseOptions& options, Rigid3* rig_from_world) {
  PoseRansac<kRays> problem(rig, observations, table, prior ? *prior : Rigid3{});
  const RansacScore start =
      prior ? problem.score(*prior, std::numeric_limits<double>::infinity()) : RansacScore{};
  return ransac(problem,
                {.max_iterations = options.max_iterations,
                 .confidence = options.confidence,
                 .seed = options.seed,
                 .stream = options.stream},
                rig_from_world, start);
}

// Marks the observations within max_error_px, whose squared residuals are given; returns how many marks
// changed.
int mark_inliers(std::span<const double> squared, double max_error_px, PoseEstimate* result) {
  int changed = 0;
  result->inlier_count = 0;
  for (size_t i = 0; i < squared.size(); ++i) {
    const bool inlier = squared[i] <= max_error_px * max_error_px;
    changed += inlier != (result->inlier[i] != 0);
    result->inlier[i] = inlier;
    result->inlier_count += inlier;
  }
  return changed;
}

// Scale of the residuals for which scale^2 (J^T J)^-1 is the covariance of the M-estimate: the mean square of
// psi over the square of the mean of its derivative, psi(r) = weight(|r|^2) r.
double effective_sigma(std::span<const double> squared, std::span<const int> active, const RobustLoss& loss) {
  constexpr double kStep = 1e-4;  // relative, for the derivative of the weight
  double psi2 = 0, slope = 0;
  for (const int i : active) {
    const double s = squared[i], weight = loss.weight(s);
    if (!std::isfinite(s)) continue;
    psi2 += weight * weight * s;
    // Half the trace of d psi / d r.
    slope += weight + (loss.weight(s * (1 + kStep)) - loss.weight(s * (1 - kStep))) / (2 * kStep);
  }
  const double n = static_cast<double>(active.size());
  return std::sqrt(psi2 / (2 * n - 6)) / (slope / n);
}

// Inverse of J^T J, scaled to a unit diagonal first because metres and radians differ. False when singular.
bool invert(const Matrix6d& hessian, Matrix6d* inverse) {
  constexpr double kMinPivot = 1e-10;
  if (!(hessian.diagonal().minCoeff() > 0)) return false;
  const Vector6d scale = hessian.diagonal().cwiseSqrt().cwiseInverse();
  const Eigen::LDLT<Matrix6d> factor(Matrix6d(scale.asDiagonal() * hessian * scale.asDiagonal()));
  if (factor.info() != Eigen::Success || !(factor.vectorD().minCoeff() > kMinPivot)) return false;
  *inverse = scale.asDiagonal() * factor.solve(Matrix6d::Identity()) * scale.asDiagonal();
  *inverse = 0.5 * (*inverse + inverse->transpose()).eval();
  return inverse->allFinite();
}

}  // namespace

Matrix6d covariance_in_world(const Rigid3& rig_from_world, const Matrix6d& covariance) {
  // c = -R^T t and R^T: the tangents (v, w) of rig_from_world become -(R^T v, R^T w).
  const Matrix3d r = rig_from_world.rotation.toRotationMatrix();
  Matrix6d turn = Matrix6d::Zero();
  turn.topLeftCorner<3, 3>() = turn.bottomRightCorner<3, 3>() = r.transpose();
  return turn * covariance * turn.transpose();
}

struct PoseEstimator::Workspace {
  RayTable rays;
  PoseResiduals all, some;
  std::vector<double> squared;  // residuals of all
  std::vector<int> active;

  int mark(double max_error_px, PoseEstimate* result) {
    all.square(result->rig_from_world, &squared);
    return mark_inliers(squared, max_error_px, result);
  }
};

PoseEstimator::PoseEstimator() : workspace_(std::make_unique<Workspace>()) {}
PoseEstimator::~PoseEstimator() = default;
PoseEstimator::PoseEstimator(PoseEstimator&&) noexcept = default;
PoseEstimator& PoseEstimator::operator=(PoseEstimator&&) noexcept = default;

void PoseEstimator::estimate(const Rig& rig, const PoseObservations& observations, const Rigid3* prior,
                             const PoseOptions& options, PoseEstimate* result) {
  const int count = observations.size();
  result->problem = PoseProblem::kTooFewObservations;
  result->inlier.assign(count, 0);
  result->inlier_count = 0;
  result->iterations = 0;
  result->sigma_px = 0;
  result->covariance.setZero();
  result->rig_from_world = prior ? *prior : Rigid3{};
  if (count < std::max(4, options.min_inliers)) return;

  Workspace& w = *workspace_;
  w.all.load(rig, observations);
  if (prior) w.mark(options.max_error_px, result);
  const bool prior_is_good = prior && result->inlier_count >= options.min_inliers &&
                             result->inlier_count >= options.prior_inlier_ratio * count;
  if (!prior_is_good) {
    fill(rig, observations, options.max_error_px, &w.rays);
    if (w.rays.size() < std::max(4, options.min_inliers)) return;
    const auto method = options.method == PoseMethod::kThreeRays ? search<3> : search<5>;
    const RansacReport report = method(rig, observations, w.rays, prior, options, &result->rig_from_world);
    result->iterations = report.iterations;
    result->problem = PoseProblem::kTooFewInliers;
    if (!report.found()) return;
    w.mark(options.max_error_px, result);
  }
  refine_loaded(rig, observations, options, result);
}

void PoseEstimator::refine(const Rig& rig, const PoseObservations& observations, const PoseOptions& options,
                           PoseEstimate* result) {
  workspace_->all.load(rig, observations);
  refine_loaded(rig, observations, options, result);
}

void PoseEstimator::refine_loaded(const Rig& rig, const PoseObservations& observations,
                                  const PoseOptions& options, PoseEstimate* result) {
  constexpr int kMaxRounds = 4;
  // Those at the threshold, of robust weight, come and go: one in so many moves nothing that noise would not.
  constexpr int kFewOf = 100;
  constexpr int kFirstIterations = 1;  // the inliers will change: no use in converging
  Workspace& w = *workspace_;
  const auto load_inliers = [&] {
    w.active.clear();
    for (int i = 0; i < observations.size(); ++i) {
      if (result->inlier[i]) w.active.push_back(i);
    }
    w.some.load(rig, observations, w.active);
    result->inlier_count = static_cast<int>(w.active.size());
    return result->inlier_count >= std::max(4, options.min_inliers);
  };
  result->problem = PoseProblem::kTooFewInliers;
  if (!load_inliers()) return;
  for (int round = 0; round < kMaxRounds; ++round) {
    const int iterations = round == 0 ? kFirstIterations : options.max_refinements;
    minimise_pose(w.some, options.loss, iterations, &result->rig_from_world);
    const int changed = w.mark(options.max_error_px, result);
    if (changed > 0 && !load_inliers()) return;
    if (round > 0 && changed * kFewOf <= result->inlier_count) break;
  }
  const auto normal = w.some.normal_equations(result->rig_from_world, {});
  result->problem = PoseProblem::kDegenerate;
  if (!invert(normal.hessian, &result->covariance)) return;
  result->sigma_px = effective_sigma(w.squared, w.active, options.loss);
  result->covariance *= result->sigma_px * result->sigma_px;
  result->problem = PoseProblem::kNone;
}

}  // namespace raysfm
