#include "raysfm/calibration/calibration_evidence.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <vector>

#include "raysfm/bundle/bundle_core.h"
#include "raysfm/bundle/scale_estimate.h"
#include "raysfm/camera/camera_class.h"
#include "raysfm/camera/ray_change.h"
#include "raysfm/core/paged_memory.h"
#include "raysfm/geometry/rotation.h"
#include "raysfm/residuals/block_residual.h"

namespace raysfm {
namespace {

// Weight that holds the logarithm of the scale: of central cameras, whose scale nothing tells; and of others,
// where it is next to nothing.
constexpr double kHoldCentral = 1e4, kHold = 1;
constexpr double kRounding = 1e-6;
// Where a pose sees too few points to be told, or a part of the map hangs on too few of them, what is not
// told is held.
constexpr double kLeastDamping = 1e-8;
constexpr int kFewUnknowns = 8;  // of one camera

// Derivatives of residuals by the parameters, and how these move with poses and points: all by rows of
// `Width` numbers, of which what exceeds the number of parameters is zero.
template <int Width>
class Measurement {
 public:
  Measurement(const BundleProblem& problem, const BundleOptions& options, const RigParameters& parameters,
              const Eigen::VectorXd& values, AngularWeight weight,
              std::span<const Eigen::Vector2d> velocities)
      : problem_(problem),
        options_(options),
        parameters_(parameters),
        values_(values),
        weight_(weight),
        velocities_(velocities),
        width_(Width == Eigen::Dynamic ? parameters.size() : Width) {}

  std::optional<CalibrationEvidence> run() {
    const bool is_central = camera_class(parameters_.given()) == CameraClass::kCentral;
    problem_.scale_prior = hold_present_scale(problem_, is_central ? kHoldCentral : kHold);
    if (problem_.scale_prior.pose < 0 || !core_.load(problem_, options_)) return std::nullopt;
    core_.linearize();
    if (!core_.solve(0).valid && !core_.solve(kLeastDamping).valid) return std::nullopt;
    number_unknowns();
    place_cameras();
    differentiate();
    const Eigen::VectorXd most = information().diagonal();
    mix();
    respond();
    eliminate();
    CalibrationEvidence evidence = collect();
    // Poses and points can only take from what is told: where they add, the equations are all but singular.
    const bool is_sound = (evidence.information.diagonal().array() <= (1 + kRounding) * most.array()).all();
    if (!is_sound || !evidence.scatter.allFinite()) return std::nullopt;
    return evidence;
  }

 private:
  template <int Rows>
  using Block = Eigen::Matrix<double, Rows, Width, Eigen::RowMajor>;
  template <int Rows>
  using BlockMap = Eigen::Map<Block<Rows>>;

  // One observation in use, divided by its standard deviation.
  struct Term {
    int observation = 0;      // of the problem
    int pose = 0, point = 0;  // of the system; pose -1: does not move
    double weight = 0;
    Eigen::Vector2d residual = {};
    Eigen::Matrix<double, 2, 6> by_pose;
    Eigen::Matrix<double, 2, 3> by_point;
  };
  // A camera with one parameter changed.
  struct Moved {
    Camera camera;
    int parameter;
    double inverse_step;
  };

  template <int Rows>
  BlockMap<Rows> rows(LargeArray<double>& all, int i) {
    return BlockMap<Rows>(&all[static_cast<size_t>(Rows) * width_ * i], Rows, width_);
  }
  BlockMap<2> by_parameters(size_t term) { return rows<2>(by_parameters_, static_cast<int>(term)); }
  BlockMap<6> pose_rows(int pose) { return rows<6>(pose_rows_, pose); }
  BlockMap<3> point_rows(int point) { return rows<3>(point_rows_, point); }

  void number_unknowns() {
    const ObservationLayout& layout = core_.layout();
    pose_number_.assign(problem_.rig_from_world.size(), -1);
    point_number_.assign(problem_.points.size(), -1);
    for (size_t i = 0; i < layout.poses.size(); ++i) pose_number_[layout.poses[i]] = static_cast<int>(i);
    for (size_t p = 0; p < layout.points.size(); ++p) point_number_[layout.points[p]] = static_cast<int>(p);
  }

  void place_cameras() {
    for (const Camera& camera : parameters_.rig(values_).cameras) {
      present_.push_back(camera);
      scanned_down_.push_back(camera);
      scanned_down_.back().shutter = {1, RollingShutter::Direction::kDown};
      scanned_right_.push_back(camera);
      scanned_right_.back().shutter = {1, RollingShutter::Direction::kRight};
    }
    moved_.resize(present_.size());
    for (int j = 0; j < parameters_.size(); ++j) {
      if (parameters_[j].kind == RigParameters::Kind::kReadout) {
        if (!velocities_.empty()) readouts_.push_back(j);
        continue;
      }
      Eigen::VectorXd moved = values_;
      moved[j] += parameters_[j].step;
      const Rig rig = parameters_.rig(moved);
      for (size_t c = 0; c < present_.size(); ++c) {
        if (parameters_.concerns(j, static_cast<int>(c)))
          moved_[c].push_back({rig.cameras[c], j, 1 / parameters_[j].step});
      }
    }
  }

  void differentiate() {
    for (const Rigid3& p : problem_.rig_from_world) rotations_.push_back(p.rotation.toRotationMatrix());
    by_parameters_.assign(2 * static_cast<size_t>(width_) * problem_.observations.size(), 0.0);
    terms_.reserve(problem_.observations.size());
    for (int c = 0; c < static_cast<int>(present_.size()); ++c) {
      const std::vector<int> seen = seen_by(c);
      problem_.rays.empty() ? differentiate_pixels(c, seen) : differentiate_angles(seen);
    }
  }

  // Observations of a camera that count.
  std::vector<int> seen_by(int camera) const {
    std::vector<int> seen;
    for (int i = 0; i < static_cast<int>(problem_.observations.size()); ++i) {
      const BundleObservation& o = problem_.observations[i];
      if (o.camera == camera && point_number_[o.point] >= 0 && problem_.uses(i)) seen.push_back(i);
    }
    return seen;
  }

  Eigen::Vector3d point_in_rig(const BundleObservation& o) const {
    return rotations_[o.pose] * problem_.points[o.point] + problem_.rig_from_world[o.pose].translation;
  }

  // A term whose derivatives by the parameters are in their place; all in the unit of the residual.
  void add_term(int i, const Eigen::Vector3d& x, const Eigen::Vector2d& residual,
                const Eigen::Matrix<double, 2, 3>& by_x) {
    const BundleObservation& o = problem_.observations[i];
    const double scale = problem_.sigmas.empty() ? 1.0 : 1 / problem_.sigmas[i];
    by_parameters(terms_.size()) *= scale;
    Term t;
    t.observation = i;
    t.pose = pose_number_[o.pose];
    t.point = point_number_[o.point];
    t.residual = scale * residual;
    t.weight = options_.loss.weight(t.residual.squaredNorm());
    t.by_pose << scale * by_x, -scale * by_x * skew(x);
    t.by_point.noalias() = scale * by_x * rotations_[o.pose];
    terms_.push_back(t);
  }

  // Eight at a time, each by every calibration that is another than the present one in one number.
  void differentiate_pixels(int c, const std::vector<int>& seen) {
    double u[kBlockLanes], v[kBlockLanes];
    const auto error_of = [&](const Camera& camera) {
      return with_pixel_residual(camera, u, v, [](auto residual) -> std::unique_ptr<BlockResidual> {
        return std::make_unique<decltype(residual)>(residual);
      });
    };
    const std::unique_ptr<BlockResidual> present = error_of(present_[c]);
    std::vector<std::unique_ptr<BlockResidual>> moved;
    for (const Moved& p : moved_[c]) moved.push_back(error_of(p.camera));
    ResidualBlock here;
    std::vector<ResidualBlock> there(moved.size());
    for (size_t begin = 0; begin < seen.size(); begin += kBlockLanes) {
      const size_t count = std::min<size_t>(kBlockLanes, seen.size() - begin);
      for (size_t k = 0; k < kBlockLanes; ++k) {
        const BundleObservation& o = problem_.observations[seen[begin + std::min(k, count - 1)]];
        const Eigen::Vector3d x = point_in_rig(o);
        for (int d = 0; d < 3; ++d) here.x[d][k] = x[d];
        u[k] = o.pixel.x(), v[k] = o.pixel.y();
      }
      present->evaluate(0, true, &here);
      for (size_t m = 0; m < moved.size(); ++m) {
        std::copy_n(&here.x[0][0], 3 * kBlockLanes, &there[m].x[0][0]);
        moved[m]->evaluate(0, false, &there[m]);
      }
      for (size_t k = 0; k < count; ++k) add_lane(c, seen[begin + k], k, here, there);
    }
  }

  void add_lane(int c, int i, size_t k, const ResidualBlock& here, const std::vector<ResidualBlock>& there) {
    const auto is_seen = [&](const ResidualBlock& block) { return std::isfinite(block.squared[k]); };
    if (!is_seen(here) || !std::ranges::all_of(there, is_seen)) return;
    const Eigen::Vector2d residual(here.residual[0][k], here.residual[1][k]);
    BlockMap<2> by_parameters = this->by_parameters(terms_.size());
    for (size_t m = 0; m < there.size(); ++m) {
      const Eigen::Vector2d moved(there[m].residual[0][k], there[m].residual[1][k]);
      by_parameters.col(moved_[c][m].parameter) = (moved - residual) * moved_[c][m].inverse_step;
    }
    for (const int j : readouts_) by_parameters.col(j) = -by_readout(i, j);
    Eigen::Matrix<double, 2, 3> by_x;
    for (int d = 0; d < 6; ++d) by_x(d / 3, d % 3) = here.jacobian[d][k];
    add_term(i, {here.x[0][k], here.x[1][k], here.x[2][k]}, residual, by_x);
  }

  void differentiate_angles(const std::vector<int>& seen) {
    for (const int i : seen) {
      const Eigen::Vector3d x = point_in_rig(problem_.observations[i]);
      Eigen::Vector2d residual;
      Eigen::Matrix<double, 2, 3> by_x;
      BlockMap<2> by_parameters = this->by_parameters(terms_.size());
      if (differentiate_angle(i, x, &residual, &by_x, by_parameters)) {
        add_term(i, x, residual, by_x);
      } else {
        by_parameters.setZero();
      }
    }
  }

  // By how much the place that an observation would have at the instant of the frame moves with a readout.
  Eigen::Vector2d by_readout(int i, int parameter) const {
    const BundleObservation& o = problem_.observations[i];
    const bool by_rows = parameters_[parameter].index == 0;
    const Camera& scanning = (by_rows ? scanned_down_ : scanned_right_)[o.camera];
    return -scanning.exposed_after(o.pixel) * velocities_[i];
  }

  // What a residual is in pixels depends on the calibration as well.
  bool differentiate_angle(int i, const Eigen::Vector3d& x, Eigen::Vector2d* residual,
                           Eigen::Matrix<double, 2, 3>* by_x, BlockMap<2> by_parameters) const {
    if (weight_ == AngularWeight::kNone)
      return differentiate_plain_angle(i, x, residual, by_x, by_parameters);
    const BundleObservation& o = problem_.observations[i];
    if (!problem_.rays[i].residual(x, residual, by_x)) return false;
    ObservedRay moved_ray;
    Eigen::Vector2d moved;
    for (const Moved& p : moved_[o.camera]) {
      if (!observe_ray(p.camera, o.pixel, weight_, &moved_ray) || !moved_ray.residual(x, &moved))
        return false;
      by_parameters.col(p.parameter) = (moved - *residual) * p.inverse_step;
    }
    for (const int j : readouts_) {
      const double step = parameters_[j].step;
      const Eigen::Vector2d moved_pixel = o.pixel + step * by_readout(i, j);
      if (!observe_ray(present_[o.camera], moved_pixel, weight_, &moved_ray) ||
          !moved_ray.residual(x, &moved)) {
        return false;
      }
      by_parameters.col(j) = (moved - *residual) / step;
    }
    return true;
  }

  // The axes of a plain angle are any: the observed ray moves and they stay.
  bool differentiate_plain_angle(int i, const Eigen::Vector3d& x, Eigen::Vector2d* residual,
                                 Eigen::Matrix<double, 2, 3>* by_x, BlockMap<2> by_parameters) const {
    const ObservedRay& ray = problem_.rays[i];
    if (!ray.residual(x, residual, by_x)) return false;
    const BundleObservation& o = problem_.observations[i];
    const double depth = ray.direction.dot(x - ray.origin);
    Ray present, moved;
    if (!ray_in_rig(present_[o.camera], o.pixel, &present)) return false;
    for (const Moved& p : moved_[o.camera]) {
      if (!ray_in_rig(p.camera, o.pixel, &moved)) return false;
      by_parameters.col(p.parameter) = residual_change(ray, depth, present, moved) * p.inverse_step;
    }
    for (const int j : readouts_) {
      const double step = parameters_[j].step;
      if (!ray_in_rig(present_[o.camera], o.pixel + step * by_readout(i, j), &moved)) return false;
      by_parameters.col(j) = residual_change(ray, depth, present, moved) / step;
    }
    return true;
  }

  Eigen::MatrixXd information() {
    Eigen::Matrix<double, Width, Width> sum = Eigen::MatrixXd::Zero(width_, width_);
    for (size_t k = 0; k < terms_.size(); ++k) {
      const BlockMap<2> d = by_parameters(k);
      sum.noalias() += (terms_[k].weight * d).transpose() * d;
    }
    return sum.topLeftCorner(parameters_.size(), parameters_.size());
  }

  // What each term says of parameters and poses, and of parameters and points, together.
  void mix() {
    pose_rows_.assign(6 * static_cast<size_t>(width_) * core_.system().pose_count(), 0.0);
    point_rows_.assign(3 * static_cast<size_t>(width_) * core_.system().point_count(), 0.0);
    Block<2> weighted(2, width_);
    for (size_t k = 0; k < terms_.size(); ++k) {
      const Term& t = terms_[k];
      weighted = t.weight * by_parameters(k);
      point_rows(t.point).noalias() += t.by_point.transpose() * weighted;
      if (t.pose >= 0) pose_rows(t.pose).noalias() += t.by_pose.transpose() * weighted;
    }
  }

  // Puts in the place of the former how poses and points move with the parameters: the solutions of the
  // normal equations, the points eliminated as in SchurSystem.
  void respond() {
    SchurSystem<6>& system = core_.system();
    for (int p = 0; p < system.point_count(); ++p) {
      BlockMap<3> b = point_rows(p);
      b = (inverse_factor(p) * b).eval();
      for (int s = system.point_begin(p); s < system.point_begin(p + 1); ++s) {
        pose_rows(system.pose_of_slot(s)).noalias() -= scaled_cross(s) * b;
      }
    }
    std::vector<double> column(6 * static_cast<size_t>(system.pose_count()));
    for (int j = 0; j < parameters_.size(); ++j) {
      for (size_t r = 0; r < column.size(); ++r) column[r] = pose_rows_[width_ * r + j];
      system.solve_reduced(column);
      for (size_t r = 0; r < column.size(); ++r) pose_rows_[width_ * r + j] = column[r];
    }
    for (int p = 0; p < system.point_count(); ++p) {
      BlockMap<3> b = point_rows(p);
      for (int s = system.point_begin(p); s < system.point_begin(p + 1); ++s) {
        b.noalias() -= scaled_cross(s).transpose() * pose_rows(system.pose_of_slot(s));
      }
      b = (inverse_factor(p).transpose() * b).eval();
    }
  }

  Eigen::Matrix3d inverse_factor(int point) {
    const double* l = core_.system().point_factor(point);
    Eigen::Matrix3d factor;
    factor << l[0], 0, 0, l[1], l[2], 0, l[3], l[4], l[5];
    return factor;
  }

  Eigen::Matrix<double, 6, 3> scaled_cross(int slot) {
    const double* z = core_.system().cross(slot);
    Eigen::Matrix<double, 6, 3> cross;
    for (int r = 0; r < 6; ++r) {
      for (int k = 0; k < 3; ++k) cross(r, k) = z[cross_place<6>(r, k)];
    }
    return cross;
  }

  // Takes from each term's derivatives by the parameters what poses and points make up for, and from its
  // residual what they still can.
  void eliminate() {
    SchurSystem<6>& system = core_.system();
    for (size_t k = 0; k < terms_.size(); ++k) {
      Term& t = terms_[k];
      BlockMap<2> effective = by_parameters(k);
      effective.noalias() -= t.by_point * point_rows(t.point);
      t.residual += t.by_point * Eigen::Map<const Eigen::Vector3d>(system.point_step(t.point));
      if (t.pose < 0) continue;
      effective.noalias() -= t.by_pose * pose_rows(t.pose);
      t.residual += t.by_pose * Eigen::Map<const Eigen::Matrix<double, 6, 1>>(system.pose_step(t.pose));
    }
  }

  CalibrationEvidence collect() {
    CalibrationEvidence evidence = CalibrationEvidence::nothing(values_);
    Eigen::Matrix<double, Width, 1> gradient = Eigen::VectorXd::Zero(width_);
    for (size_t k = 0; k < terms_.size(); ++k) {
      const Term& t = terms_[k];
      gradient.noalias() += by_parameters(k).transpose() * (t.weight * t.residual);
      evidence.cost += 0.5 * options_.loss.cost(t.residual.squaredNorm());
    }
    evidence.gradient = gradient.head(parameters_.size());
    evidence.information = information();
    evidence.observations = static_cast<int>(terms_.size());
    const std::vector<int> cluster_of = clusters_of_points();
    evidence.scatter = scatter(best_step(evidence, false), cluster_of);
    evidence.lens_scatter =
        readouts_.empty() ? evidence.scatter : scatter(best_step(evidence, true), cluster_of);
    return evidence;
  }

  // To the calibration that these observations and the prior make most likely; readouts, which come last, may
  // be held.
  Eigen::VectorXd best_step(const CalibrationEvidence& e, bool hold_readouts) const {
    const Eigen::Index m = parameters_.size();
    const Eigen::Index n = hold_readouts ? m - static_cast<Eigen::Index>(readouts_.size()) : m;
    const bool is_bent = !hold_readouts && !readouts_.empty();
    const Eigen::VectorXd prior =
        e.cost / std::max(1, e.observations) * parameters_.prior_sigma(is_bent).head(n).array().pow(-2);
    const Eigen::MatrixXd prior_matrix = prior.asDiagonal();
    const Eigen::MatrixXd information = e.information.topLeftCorner(n, n) + prior_matrix;
    const Eigen::VectorXd right = -e.gradient.head(n) - prior_matrix * e.at.head(n);
    Eigen::VectorXd step = Eigen::VectorXd::Zero(m);
    step.head(n) = information.ldlt().solve(right);
    return step;
  }

  // Errors go together in the points of a neighbourhood that were first seen at about the same time, and in
  // an image. What is left of them after a step, so that what a wrong calibration does to all alike is no
  // scatter.
  Eigen::MatrixXd scatter(const Eigen::VectorXd& step, const std::vector<int>& cluster_of) {
    const int images = static_cast<int>(problem_.rig_from_world.size());
    LargeArray<double> clusters(static_cast<size_t>(width_) * (cluster_count() + images), 0.0);
    const auto part_of = [&](int cluster) { return rows<1>(clusters, cluster); };
    Eigen::Matrix<double, Width, 1> padded = Eigen::VectorXd::Zero(width_);
    padded.head(step.size()) = step;
    Block<1> part(1, width_);
    for (size_t k = 0; k < terms_.size(); ++k) {
      const Term& t = terms_[k];
      const BundleObservation& o = problem_.observations[t.observation];
      const BlockMap<2> effective = by_parameters(k);
      const Eigen::Vector2d residual = t.residual + effective * padded;
      part.noalias() = (t.weight * residual).transpose() * effective;
      part_of(cluster_of[t.point]) += part;
      part_of(cluster_count() + o.pose) += part;
    }
    Eigen::MatrixXd sum = Eigen::MatrixXd::Zero(width_, width_);
    for (int c = 0; c < cluster_count() + images; ++c) sum += part_of(c).transpose() * part_of(c);
    return sum.topLeftCorner(step.size(), step.size());
  }

  static constexpr int kColumns = 6, kRows = 4, kPoses = 5;  // of a neighbourhood

  // Terms run camera by camera, and the first observation of a point may be another one's.
  std::vector<int> clusters_of_points() const {
    std::vector<int> first(core_.layout().points.size(), std::numeric_limits<int>::max());
    for (const Term& t : terms_) first[t.point] = std::min(first[t.point], t.observation);
    std::vector<int> clusters;
    for (const int i : first) {
      const bool is_seen = i < std::numeric_limits<int>::max();
      clusters.push_back(is_seen ? cluster_of_point(problem_.observations[i]) : -1);
    }
    return clusters;
  }

  int cluster_of_point(const BundleObservation& first) const {
    const Camera& camera = present_[first.camera];
    const auto cell = [](double x, int size, int count) {
      return std::clamp(static_cast<int>(x / size * count), 0, count - 1);
    };
    const int row = cell(first.pixel.y(), camera.height, kRows);
    const int column = cell(first.pixel.x(), camera.width, kColumns);
    const int period = first.pose / kPoses;
    return ((period * static_cast<int>(present_.size()) + first.camera) * kRows + row) * kColumns + column;
  }

  int cluster_count() const {
    const int periods = (static_cast<int>(problem_.rig_from_world.size()) + kPoses - 1) / kPoses;
    return periods * static_cast<int>(present_.size()) * kRows * kColumns;
  }

  BundleProblem problem_;
  BundleOptions options_;
  const RigParameters& parameters_;
  const Eigen::VectorXd& values_;
  const AngularWeight weight_;
  const std::span<const Eigen::Vector2d> velocities_;
  const int width_;
  BundleCore<6> core_;
  std::vector<int> pose_number_, point_number_;
  std::vector<Eigen::Matrix3d> rotations_;  // of poses of the problem
  std::vector<Camera> present_;
  std::vector<std::vector<Moved>> moved_;             // by camera, by parameter that concerns it
  std::vector<int> readouts_;                         // parameters that are one
  std::vector<Camera> scanned_down_, scanned_right_;  // the cameras, each in a second
  std::vector<Term> terms_;
  LargeArray<double> by_parameters_, pose_rows_, point_rows_;
};

}  // namespace

CalibrationEvidence CalibrationEvidence::nothing(const Eigen::VectorXd& at) {
  const Eigen::Index m = at.size();
  const Eigen::MatrixXd none = Eigen::MatrixXd::Zero(m, m);
  return {at, none, Eigen::VectorXd::Zero(m), none, none};
}

void CalibrationEvidence::add(const CalibrationEvidence& other) {
  information += other.information;
  gradient += other.gradient + other.information * (at - other.at);
  scatter += other.scatter;
  lens_scatter += other.lens_scatter;
  cost += other.cost;
  observations += other.observations;
}

std::optional<CalibrationEvidence> measure_calibration(const BundleProblem& problem,
                                                       const BundleOptions& options,
                                                       const RigParameters& parameters,
                                                       const Eigen::VectorXd& values, AngularWeight weight,
                                                       std::span<const Eigen::Vector2d> velocities) {
  if (parameters.size() == 0 || !problem.lenses.empty()) return std::nullopt;
  if (parameters.size() <= kFewUnknowns) {
    return Measurement<kFewUnknowns>(problem, options, parameters, values, weight, velocities).run();
  }
  return Measurement<Eigen::Dynamic>(problem, options, parameters, values, weight, velocities).run();
}

}  // namespace raysfm
