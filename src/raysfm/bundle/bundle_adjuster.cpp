#include "raysfm/bundle/bundle_adjuster.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <utility>
#include <variant>
#include <vector>

#include "raysfm/bundle/angular_residual.h"
#include "raysfm/bundle/normal_kernel.h"
#include "raysfm/bundle/observation_layout.h"
#include "raysfm/bundle/pixel_residual.h"
#include "raysfm/core/timer.h"
#include "raysfm/optim/schur_system.h"

namespace raysfm {
namespace {

using RowMajor3 = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;

constexpr int kChunk = 4;  // blocks

// Poses, points and what each lane costs there.
struct State {
  std::vector<Rigid3> poses;
  std::vector<Eigen::Vector3d> points;
  std::vector<double> lane_cost;

  void load(const BundleProblem& problem, size_t lane_count) {
    poses.assign(problem.rig_from_world.begin(), problem.rig_from_world.end());
    points.assign(problem.points.begin(), problem.points.end());
    lane_cost.assign(lane_count, 0.0);
  }
};

void gather_points(const State& state, const ObservationLayout::Lane* lanes, double (*out)[kBundleLanes]) {
  for (int k = 0; k < kBundleLanes; ++k) {
    const Eigen::Vector3d& p = state.points[lanes[k].point];
    out[0][k] = p.x(), out[1][k] = p.y(), out[2][k] = p.z();
  }
}

void clear_lane(ObservationBlock& block, int k) {
  for (auto& row : block.x) row[k] = 0;
  for (auto& row : block.residual) row[k] = 0;
  for (auto& row : block.jacobian) row[k] = 0;
  block.weight[k] = 0;
}

}  // namespace

// The state of one run; levenberg_marquardt() drives it.
class BundleAdjuster::Workspace {
 public:
  bool load(const BundleProblem& problem, const BundleOptions& options);
  void store(const BundleProblem& problem) const;
  int used() const { return active_count_; }
  int dropped() const { return dropped_; }

  double linearize();
  LmStep solve(double damping) { return system_.solve(damping); }
  LmTrial evaluate(bool linearize);
  void accept();

 private:
  double work(State& state, bool linearize);
  template <bool kJacobian, typename Residual>
  double work_on_group(const ObservationLayout::Group& group, const Residual& residual, State& state);
  template <bool kJacobian, typename Residual>
  double evaluate_block(const Residual& residual, int begin, ObservationBlock& block,
                        std::vector<double>& lane_cost);
  void add_block(int begin, const ObservationBlock& block);
  bool projects(const State& state, int lane) const;
  void shorten_steps_of_lost();
  void drop_lost();
  double cost_without_lost(const State& state);

  std::span<const Camera> cameras_;
  std::span<const BundleObservation> observations_;
  std::span<const ObservedRay> rays_;
  RobustLoss loss_;
  ObservationLayout layout_;
  SchurSystem system_;
  State current_, trial_;
  std::vector<uint8_t> active_;  // by lane: an inlier that projects
  std::vector<int> lost_;        // active lanes that did not project in the last pass
  int active_count_ = 0, dropped_ = 0;
  double current_cost_ = 0, trial_cost_ = 0;
  ObservationBlock blocks_[kChunk];
  PoseSums pose_sums_;
};

bool BundleAdjuster::Workspace::load(const BundleProblem& problem, const BundleOptions& options) {
  cameras_ = problem.cameras;
  observations_ = problem.observations;
  rays_ = problem.rays;
  loss_ = options.loss;
  layout_.build(problem);
  active_.clear();
  active_count_ = dropped_ = 0;
  for (const ObservationLayout::Lane& lane : layout_.lanes) {
    active_.push_back(lane.observation >= 0);
    active_count_ += active_.back();
  }
  lost_.clear();
  lost_.reserve(layout_.lanes.size());
  current_.load(problem, layout_.lanes.size());
  trial_.load(problem, layout_.lanes.size());
  if (layout_.poses.empty() && layout_.points.empty()) return false;
  system_.set_structure(static_cast<int>(layout_.poses.size()), layout_.point_begin, layout_.pose_of_slot);
  return true;
}

void BundleAdjuster::Workspace::store(const BundleProblem& problem) const {
  for (int i : layout_.poses) problem.rig_from_world[i] = current_.poses[i];
  for (int p : layout_.points) problem.points[p] = current_.points[p];
}

double BundleAdjuster::Workspace::linearize() {
  current_cost_ = work(current_, true);
  drop_lost();
  return current_cost_;
}

LmTrial BundleAdjuster::Workspace::evaluate(bool linearize) {
  using Vector6 = Eigen::Matrix<double, 6, 1>;
  for (size_t i = 0; i < layout_.poses.size(); ++i) {
    const Eigen::Map<const Vector6> step(system_.pose_step(static_cast<int>(i)));
    trial_.poses[layout_.poses[i]] = retract(current_.poses[layout_.poses[i]], step);
  }
  for (size_t p = 0; p < layout_.points.size(); ++p) {
    const Eigen::Map<const Eigen::Vector3d> step(system_.point_step(static_cast<int>(p)));
    trial_.points[layout_.points[p]] = current_.points[layout_.points[p]] + step;
  }
  trial_cost_ = work(trial_, linearize);
  if (!lost_.empty()) {
    shorten_steps_of_lost();
    trial_cost_ = work(trial_, linearize);
  }
  if (lost_.empty()) return {current_cost_, trial_cost_};
  constexpr size_t kMostLost = 50;  // one in so many
  if (lost_.size() * kMostLost > static_cast<size_t>(active_count_)) return {current_cost_, INFINITY};
  return {cost_without_lost(current_), trial_cost_};
}

void BundleAdjuster::Workspace::accept() {
  drop_lost();
  std::swap(current_, trial_);
  current_cost_ = trial_cost_;
}

bool BundleAdjuster::Workspace::projects(const State& state, int lane) const {
  const int i = layout_.lanes[lane].observation;
  const BundleObservation& o = observations_[i];
  const Eigen::Vector3d x_in_rig = state.poses[o.pose] * state.points[o.point];
  Eigen::Vector2d unused;
  if (!rays_.empty()) return rays_[i].residual(x_in_rig, &unused);
  const Camera& camera = cameras_[o.camera];
  return camera.project(camera.rig_from_cam.inverse() * x_in_rig, &unused);
}

void BundleAdjuster::Workspace::shorten_steps_of_lost() {
  constexpr int kMostTries = 4;
  for (int k : lost_) {
    const int p = layout_.lanes[k].point;
    for (int i = 0; i < kMostTries && !projects(trial_, k); ++i) {
      trial_.points[p] = current_.points[p] + 0.25 * (trial_.points[p] - current_.points[p]);
    }
  }
}

void BundleAdjuster::Workspace::drop_lost() {
  for (int k : lost_) active_[k] = 0;
  active_count_ -= static_cast<int>(lost_.size());
  dropped_ += static_cast<int>(lost_.size());
  lost_.clear();
}

double BundleAdjuster::Workspace::cost_without_lost(const State& state) {
  for (int k : lost_) active_[k] = 0;
  double sum = 0;
  for (size_t k = 0; k < active_.size(); ++k) sum += active_[k] ? state.lane_cost[k] : 0.0;
  for (int k : lost_) active_[k] = 1;
  return sum;
}

// Costs of all active lanes, and the normal equations if asked. Lanes that do not project go to lost_ and are
// in neither.
double BundleAdjuster::Workspace::work(State& state, bool linearize) {
  lost_.clear();
  if (linearize) system_.set_zero();
  double cost = 0;
  for (const ObservationLayout::Group& group : layout_.groups) {
    if (!rays_.empty()) {
      const AngularResidual residual{rays_, layout_.lanes};
      cost += linearize ? work_on_group<true>(group, residual, state)
                        : work_on_group<false>(group, residual, state);
      continue;
    }
    const Camera& camera = cameras_[group.camera];
    cost += std::visit(
        [&](const auto& model) {
          const PixelResidual residual(camera, model, layout_.u.data(), layout_.v.data());
          return linearize ? work_on_group<true>(group, residual, state)
                           : work_on_group<false>(group, residual, state);
        },
        camera.model);
  }
  return cost;
}

// By chunks of a few blocks: what one loop writes lane by lane, the next reads by whole vectors, and the
// processor stalls when the two come too close.
template <bool kJacobian, typename Residual>
double BundleAdjuster::Workspace::work_on_group(const ObservationLayout::Group& group,
                                                const Residual& residual, State& state) {
  const Rigid3& pose = state.poses[group.pose];
  const RowMajor3 rotation = pose.rotation.toRotationMatrix();
  const bool moves = group.system_pose >= 0;
  if (kJacobian && moves) std::memset(&pose_sums_, 0, sizeof(pose_sums_));
  double cost = 0;
  for (int begin = group.begin; begin < group.end; begin += kChunk * kBundleLanes) {
    const int count = std::min(kChunk, (group.end - begin) / kBundleLanes);
    for (int i = 0; i < count; ++i)
      gather_points(state, &layout_.lanes[begin + i * kBundleLanes], blocks_[i].x);
    transform_points(rotation.data(), pose.translation.data(), blocks_, count);
    for (int i = 0; i < count; ++i) {
      cost += evaluate_block<kJacobian>(residual, begin + i * kBundleLanes, blocks_[i], state.lane_cost);
    }
    if (!kJacobian) continue;
    if (moves) {
      point_and_pose_terms(rotation.data(), blocks_, count, &pose_sums_);
    } else {
      point_terms(rotation.data(), blocks_, count);
    }
    for (int i = 0; i < count; ++i) add_block(begin + i * kBundleLanes, blocks_[i]);
  }
  if (kJacobian && moves) {
    SchurSystem::PoseBlock& block = system_.pose(group.system_pose);
    add_pose_sums(pose_sums_, block.u, block.gradient);
  }
  return cost;
}

// Residuals of eight lanes from their points in the rig's frame; returns their cost.
template <bool kJacobian, typename Residual>
double BundleAdjuster::Workspace::evaluate_block(const Residual& residual, int begin, ObservationBlock& block,
                                                 std::vector<double>& lane_cost) {
  const RobustLoss loss = loss_;
  double cost = 0;
  for (int k = 0; k < kBundleLanes; ++k) {
    const Eigen::Vector3d x(block.x[0][k], block.x[1][k], block.x[2][k]);
    Eigen::Vector2d r;
    Eigen::Matrix<double, 2, 3> jacobian;
    double squared = INFINITY;
    if (active_[begin + k]) {
      if (residual(x, begin + k, &r, kJacobian ? &jacobian : nullptr)) squared = r.squaredNorm();
      if (!std::isfinite(squared)) lost_.push_back(begin + k);
    }
    if (!std::isfinite(squared)) {
      if (kJacobian) clear_lane(block, k);
      continue;
    }
    cost += lane_cost[begin + k] = 0.5 * loss.cost(squared);
    if (!kJacobian) continue;
    block.residual[0][k] = r[0], block.residual[1][k] = r[1];
    for (int c = 0; c < 6; ++c) block.jacobian[c][k] = jacobian(c / 3, c % 3);
    block.weight[k] = loss.weight(squared);
  }
  return cost;
}

void BundleAdjuster::Workspace::add_block(int begin, const ObservationBlock& block) {
  for (int k = 0; k < kBundleLanes; ++k) {
    const ObservationLayout::Lane& lane = layout_.lanes[begin + k];
    if (lane.system_point < 0) continue;
    PointBlock& point = system_.point(lane.system_point);
    for (int c = 0; c < 6; ++c) point.v[c] += block.point[c][k];
    for (int c = 0; c < 3; ++c) point.gradient[c] += block.point[6 + c][k];
    if (lane.slot < 0) continue;
    double* cross = system_.cross(lane.slot);
    for (int c = 0; c < 3; ++c) {
      for (int r = 0; r < 6; ++r) cross[kCrossRows * c + r] += block.cross[6 * c + r][k];
    }
  }
}

BundleAdjuster::BundleAdjuster() : workspace_(std::make_unique<Workspace>()) {}
BundleAdjuster::~BundleAdjuster() = default;
BundleAdjuster::BundleAdjuster(BundleAdjuster&&) noexcept = default;
BundleAdjuster& BundleAdjuster::operator=(BundleAdjuster&&) noexcept = default;

BundleSummary BundleAdjuster::adjust(const BundleProblem& problem, const BundleOptions& options) {
  const Clock::time_point start = Clock::now();
  BundleSummary summary;
  if (!is_valid(problem, options)) {
    summary.termination = Termination::kInvalidProblem;
    return summary;
  }
  if (workspace_->load(problem, options)) {
    const LmSummary lm =
        levenberg_marquardt(*workspace_, LmOptions{options.max_iterations, options.min_relative_decrease,
                                                   options.initial_damping, &options.progress});
    workspace_->store(problem);
    summary.initial_cost = lm.initial_cost;
    summary.final_cost = lm.final_cost;
    summary.iterations = lm.iterations;
    summary.termination = workspace_->used() > 0 ? lm.termination : Termination::kNothingToDo;
  }
  summary.used_observations = workspace_->used();
  summary.dropped_observations = workspace_->dropped();
  summary.solve_ms = milliseconds_since(start);
  return summary;
}

BundleSummary BundleAdjuster::adjust_two_stage(const BundleProblem& problem, const BundleOptions& options,
                                               double inlier_threshold) {
  const Clock::time_point start = Clock::now();
  const BundleSummary first = adjust(problem, options);
  if (first.termination == Termination::kInvalidProblem) return first;
  update_inliers(problem, inlier_threshold);
  BundleSummary summary = adjust(problem, options);
  update_inliers(problem, inlier_threshold);
  summary.initial_cost = first.initial_cost;
  summary.iterations += first.iterations;
  summary.solve_ms = milliseconds_since(start);
  return summary;
}

int update_inliers(const BundleProblem& problem, double inlier_threshold) {
  int inliers = 0;
  int camera_index = -1;  // of cam_from_rig
  Rigid3 cam_from_rig;
  for (size_t i = 0; i < problem.observations.size() && i < problem.is_inlier.size(); ++i) {
    const BundleObservation& o = problem.observations[i];
    const Eigen::Vector3d x_in_rig = problem.rig_from_world[o.pose] * problem.points[o.point];
    Eigen::Vector2d residual;
    bool fits;
    if (!problem.rays.empty()) {
      fits = problem.rays[i].residual(x_in_rig, &residual);
    } else {
      const Camera& camera = problem.cameras[o.camera];
      if (o.camera != camera_index) cam_from_rig = camera.rig_from_cam.inverse();
      camera_index = o.camera;
      fits = camera.project(cam_from_rig * x_in_rig, &residual);
      residual -= o.pixel;
    }
    fits = fits && residual.squaredNorm() <= inlier_threshold * inlier_threshold;
    problem.is_inlier[i] = fits;
    inliers += fits;
  }
  return inliers;
}

}  // namespace raysfm
