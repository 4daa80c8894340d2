#include "raysfm/bundle/bundle_core.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <utility>

#include "raysfm/bundle/problem_part.h"
#include "raysfm/bundle/residual.h"

namespace raysfm {
namespace {

constexpr int kChunk = 4;          // blocks of lanes
constexpr int kPointChunk = 1024;  // points
// A point that would lower the cost by this part of the variance of the residuals moves by itself; steps that
// it then has at once. By a loss that redescends not before a step of the poses of at most so many standard
// deviations: with poses far off, points would leave out what fits in the end.
constexpr double kUnsettled = 0.01, kNear = 20;
constexpr int kSettlingSteps = 10;

}  // namespace

template <int N>
void BundleCore<N>::State::load(const BundleProblem& problem, size_t lane_count) {
  poses.assign(problem.rig_from_world.begin(), problem.rig_from_world.end());
  lenses.assign(problem.lenses.begin(), problem.lenses.end());
  points.assign(problem.points.begin(), problem.points.end());
  lane_cost.assign(lane_count, 0.0);
}

template <int N>
bool BundleCore<N>::load(const BundleProblem& problem, const BundleOptions& options, Taking taking) {
  problem_ = problem;
  loss_ = options.loss;
  settled_ = options.settled;
  settles_ = false;
  if (!team_ || team_->threads() != options.threads) team_ = std::make_unique<WorkTeam>(options.threads);
  layout_.build(problem, taking);
  const size_t lanes = layout_.lanes.size();
  active_.resize(lanes);
  active_count_ = dropped_ = 0;
  for (size_t k = 0; k < lanes; ++k) {
    const int i = layout_.lanes[k].observation;
    active_[k] = i >= 0 && problem.uses(i);
    active_count_ += active_[k];
  }
  is_lost_.assign(lanes, 0);
  lost_.clear();
  lost_.reserve(lanes);
  chunk_cost_.resize(layout_.chunks.size());
  chunk_loses_.resize(layout_.chunks.size());
  set_size(point_terms_, team_->threads() > 1 ? 9 * lanes : 0);
  load_rays();
  current_.load(problem, lanes);
  trial_.load(problem, lanes);
  const auto prior_pose = std::find(layout_.poses.begin(), layout_.poses.end(), problem.scale_prior.pose);
  prior_pose_ = prior_pose == layout_.poses.end() ? -1 : static_cast<int>(prior_pose - layout_.poses.begin());
  if (layout_.poses.empty() && layout_.points.empty()) return false;
  system_.set_structure(static_cast<int>(layout_.poses.size()), layout_.point_begin, layout_.pose_of_slot);
  return true;
}

template <int N>
void BundleCore<N>::load_rays() {
  if (problem_.rays.empty()) return;
  rays_.resize(layout_.lanes.size() / kBlockLanes);
  for (size_t k = 0; k < layout_.lanes.size(); ++k) {
    const int i = layout_.lanes[k].observation;
    const ObservedRay ray = i >= 0 ? problem_.rays[i] : ObservedRay{};
    set_ray(ray, k % kBlockLanes, &rays_[k / kBlockLanes]);
  }
}

template <int N>
void BundleCore<N>::store() const {
  for (int i : layout_.poses) problem_.rig_from_world[i] = current_.poses[i];
  for (int p : layout_.points) problem_.points[p] = current_.points[p];
  if constexpr (N == 9) {
    for (int i : layout_.poses) problem_.lenses[i] = current_.lenses[i];
  }
}

template <int N>
double BundleCore<N>::linearize() {
  current_cost_ = work(current_, true);
  drop_lost();
  return current_cost_;
}

// Only where no damping so far gave a step are there two solutions of the same equations.
template <int N>
LmStep BundleCore<N>::solve(double damping) {
  if (is_used_up_) work(current_, true);
  is_used_up_ = true;
  LmStep step = system_.solve(damping, *team_);
  if (settled_ > 0 && step.valid) find_unsettled(&step);
  return step;
}

// The state that the step of the system leads to.
template <int N>
void BundleCore<N>::move(State& state) const {
  for (size_t i = 0; i < layout_.poses.size(); ++i) {
    const int pose = layout_.poses[i];
    const double* step = system_.pose_step(static_cast<int>(i));
    state.poses[pose] = retract(current_.poses[pose], Eigen::Map<const Eigen::Matrix<double, 6, 1>>(step));
    if constexpr (N == 9) {
      const BalLens& lens = current_.lenses[pose];
      state.lenses[pose] = {lens.f + step[6], lens.k1 + step[7], lens.k2 + step[8]};
    }
  }
  for (size_t p = 0; p < layout_.points.size(); ++p) {
    const Eigen::Map<const Eigen::Vector3d> step(system_.point_step(static_cast<int>(p)));
    state.points[layout_.points[p]] = current_.points[layout_.points[p]] + step;
  }
}

template <int N>
LmTrial BundleCore<N>::evaluate(bool linearize) {
  linearize = linearize && !settles_;  // points will move once more
  move(trial_);
  trial_cost_ = work(trial_, linearize);
  if (!lost_.empty()) {
    shorten_steps_of_lost();
    trial_cost_ = work(trial_, linearize);
  }
  if (lost_.empty()) return {current_cost_, trial_cost_, linearize};
  constexpr size_t kMostLost = 50;  // one in so many
  if (lost_.size() * kMostLost > static_cast<size_t>(active_count_))
    return {current_cost_, INFINITY, linearize};
  return {cost_without_lost(current_), trial_cost_, linearize};
}

template <int N>
void BundleCore<N>::accept() {
  drop_lost();
  std::swap(current_, trial_);
  current_cost_ = trial_cost_;
  if (settles_) settle_points();
}

// What the poses promise is what is left of the whole without what each point promises by itself.
template <int N>
void BundleCore<N>::find_unsettled(LmStep* step) {
  const double variance = current_cost_ / std::max(1, active_count_);
  is_unsettled_.assign(problem_.points.size(), 0);
  double of_points = 0;
  for (size_t p = 0; p < layout_.points.size(); ++p) {
    const double decrease = system_.decrease_of_point(static_cast<int>(p));
    of_points += decrease;
    is_unsettled_[layout_.points[p]] = decrease > kUnsettled * variance;
  }
  const double length2 = 2 * (step->decrease - of_points) / variance;
  step->settled = length2 <= settled_ * settled_;
  settles_ = !loss_.redescends() || length2 <= kNear * kNear;
}

template <int N>
void BundleCore<N>::settle_points() {
  all_held_.assign(problem_.rig_from_world.size(), 0);
  BundleProblem now = problem_;
  now.rig_from_world = current_.poses;
  now.pose_is_free = all_held_;
  now.lenses = current_.lenses;
  now.points = current_.points;
  now.scale_prior = {};
  PartOfPoints moving(now, is_unsettled_, true);
  if (moving.empty()) return;
  if (!of_points_) of_points_ = std::make_unique<BundleCore>();
  BundleOptions options;
  options.loss = loss_;
  options.threads = team_->threads();
  if (!of_points_->load(moving.problem(), options)) return;
  levenberg_marquardt(*of_points_, LmOptions{.max_iterations = kSettlingSteps});
  of_points_->store();
  moving.store();
}

template <int N>
bool BundleCore<N>::has_residual(const State& state, int lane) const {
  const int i = layout_.lanes[lane].observation;
  const BundleObservation& o = problem_.observations[i];
  const BalLens lens = N == 9 ? state.lenses[o.pose] : BalLens{};
  Eigen::Vector2d unused;
  return residual_of(problem_, i, state.poses[o.pose], lens, state.points[o.point], &unused);
}

template <int N>
void BundleCore<N>::shorten_steps_of_lost() {
  constexpr int kMostTries = 4;
  for (int k : lost_) {
    const int p = layout_.lanes[k].point;
    for (int i = 0; i < kMostTries && !has_residual(trial_, k); ++i) {
      trial_.points[p] = current_.points[p] + 0.25 * (trial_.points[p] - current_.points[p]);
    }
  }
}

template <int N>
void BundleCore<N>::drop_lost() {
  for (int k : lost_) active_[k] = 0;
  active_count_ -= static_cast<int>(lost_.size());
  dropped_ += static_cast<int>(lost_.size());
  lost_.clear();
}

template <int N>
double BundleCore<N>::cost_without_lost(const State& state) {
  for (int k : lost_) active_[k] = 0;
  double sum = 0;
  for (size_t k = 0; k < active_.size(); ++k) sum += active_[k] ? state.lane_cost[k] : 0.0;
  for (int k : lost_) active_[k] = 1;
  return sum + scale_prior_cost(state, false);
}

// Costs of all active lanes, and the normal equations if asked. Lanes without a residual go to lost_ and are
// in neither.
template <int N>
double BundleCore<N>::work(State& state, bool linearize) {
  const int chunks = static_cast<int>(layout_.chunks.size()) - 1;
  const int points = static_cast<int>(layout_.points.size());
  if (linearize) {
    is_used_up_ = false;
    if (point_terms_.empty()) clear_points();
  }
  team_->run(chunks, [&](int chunk) { chunk_cost_[chunk] = work_on_chunk(chunk, state, linearize); });
  if (linearize && !point_terms_.empty()) {
    team_->run((points + kPointChunk - 1) / kPointChunk, [&](int chunk) {
      sum_points(chunk * kPointChunk, std::min(points, (chunk + 1) * kPointChunk));
    });
  }
  collect_lost();
  double cost = 0;
  for (int chunk = 0; chunk < chunks; ++chunk) cost += chunk_cost_[chunk];
  return cost + scale_prior_cost(state, linearize);
}

// With v the translational tangent of rig_from_world, c = -R^T t changes by -R^T v.
template <int N>
double BundleCore<N>::scale_prior_cost(const State& state, bool linearize) {
  if (prior_pose_ < 0) return 0;
  const ScalePrior& prior = problem_.scale_prior;
  const Rigid3& pose = state.poses[prior.pose];
  const Eigen::Vector3d step = pose.inverse().translation - state.poses[prior.from].inverse().translation;
  const double length = step.norm();
  if (!(length > 0)) return INFINITY;
  const double r = std::log(length / prior.distance);
  if (linearize) {
    const Eigen::Vector3d by_v = -(pose.rotation * step) / (length * length);
    auto& block = system_.pose(prior_pose_);
    for (int c = 0; c < 3; ++c) {
      for (int row = c; row < 3; ++row) block.u[N * c + row] += prior.weight * by_v[row] * by_v[c];
      block.gradient[c] += prior.weight * by_v[c] * r;
    }
  }
  return 0.5 * prior.weight * r * r;
}

template <int N>
void BundleCore<N>::collect_lost() {
  lost_.clear();
  for (size_t chunk = 0; chunk + 1 < layout_.chunks.size(); ++chunk) {
    if (!chunk_loses_[chunk]) continue;
    for (int g = layout_.chunks[chunk]; g < layout_.chunks[chunk + 1]; ++g) {
      for (int k = layout_.groups[g].begin; k < layout_.groups[g].end; ++k) {
        if (is_lost_[k]) lost_.push_back(k);
      }
    }
  }
}

template <int N>
double BundleCore<N>::work_on_chunk(int chunk, State& state, bool linearize) {
  double cost = 0;
  bool loses = false;
  for (int g = layout_.chunks[chunk]; g < layout_.chunks[chunk + 1]; ++g) {
    cost += work_on_group(layout_.groups[g], state, linearize, &loses);
  }
  chunk_loses_[chunk] = loses;
  return cost;
}

template <int N>
template <typename Use>
auto BundleCore<N>::with_residual(const ObservationLayout::Group& group, const State& state, Use use) const {
  const double *u = layout_.u.data(), *v = layout_.v.data();
  if constexpr (N == 9) {
    return use(LensResidual(state.lenses[group.pose], u, v));
  } else {
    if (!problem_.rays.empty()) return use(AngularResidual(rays_.data()));
    return with_pixel_residual(problem_.cameras[group.camera], u, v, use);
  }
}

template <int N>
double BundleCore<N>::work_on_group(const ObservationLayout::Group& group, State& state, bool linearize,
                                    bool* loses) {
  return with_residual(group, state, [&](const BlockResidual& residual) {
    return work_on_lanes(group, residual, state, linearize, loses);
  });
}

template <int N>
BundleCore<N>::Frame::Frame(const Rigid3& pose)
    : rotation(pose.rotation.toRotationMatrix()), translation(pose.translation) {
  if (rotation.allFinite()) return;
  rotation.setIdentity();  // nothing of it may get into the sums
  translation.setConstant(NAN);
}

template <int N>
void BundleCore<N>::load_points(int begin, const State& state, Block* block) const {
  for (int k = 0; k < kBlockLanes; ++k) {
    const Eigen::Vector3d& p = state.points[layout_.lanes[begin + k].point];
    for (int c = 0; c < 3; ++c) block->x[c][k] = p[c];
  }
}

template <int N>
void BundleCore<N>::mark_inliers(double threshold) {
  active_count_ = dropped_ = 0;
  for (const ObservationLayout::Group& group : layout_.groups) {
    with_residual(group, current_,
                  [&](const BlockResidual& residual) { mark_group(group, residual, threshold); });
  }
}

template <int N>
void BundleCore<N>::mark_group(const ObservationLayout::Group& group, const BlockResidual& residual,
                               double threshold) {
  const Frame frame(current_.poses[group.pose]);
  Block block;
  for (int begin = group.begin; begin < group.end; begin += kBlockLanes) {
    load_points(begin, current_, &block);
    transform_points(frame.rotation.data(), frame.translation.data(), &block);
    residual.evaluate(begin, false, &block);
    for (int k = begin; k < begin + kBlockLanes; ++k) {
      const int i = layout_.lanes[k].observation;
      if (i < 0) continue;
      const double weight = layout_.weight.empty() ? 1.0 : layout_.weight[k];
      const bool fits = weight * block.squared[k - begin] <= threshold * threshold;  // false for NaN
      active_[k] = problem_.is_inlier[i] = fits;
      active_count_ += fits;
    }
  }
}

// By chunks of a few blocks: what one loop writes lane by lane, the next reads by whole vectors, and the
// processor stalls when the two come too close.
template <int N>
double BundleCore<N>::work_on_lanes(const ObservationLayout::Group& group, const BlockResidual& residual,
                                    State& state, bool linearize, bool* loses) {
  const Frame frame(state.poses[group.pose]);
  const bool moves = linearize && group.system_pose >= 0;
  PoseSums<N> sums;
  if (moves) std::memset(&sums, 0, sizeof(sums));
  Block blocks[kChunk];
  double lane_sums[kBlockLanes] = {};
  for (int begin = group.begin; begin < group.end; begin += kChunk * kBlockLanes) {
    const int count = std::min(kChunk, (group.end - begin) / kBlockLanes);
    for (int i = 0; i < count; ++i) load_points(begin + i * kBlockLanes, state, &blocks[i]);
    for (int i = 0; i < count; ++i) {
      transform_points(frame.rotation.data(), frame.translation.data(), &blocks[i]);
      residual.evaluate(begin + i * kBlockLanes, linearize, &blocks[i]);
    }
    for (int i = 0; i < count; ++i) {
      if (score_block(begin + i * kBlockLanes, blocks[i], state.lane_cost, lane_sums)) *loses = true;
    }
    if (!linearize) continue;
    for (int i = 0; i < count; ++i) {
      if (moves) {
        point_and_pose_terms(frame.rotation.data(), &blocks[i], &sums);
      } else {
        point_terms(frame.rotation.data(), &blocks[i]);
      }
    }
    for (int i = 0; i < count; ++i) store_block(begin + i * kBlockLanes, blocks[i]);
  }
  if (moves) {
    auto& block = system_.pose(group.system_pose);
    if (group.opens_pose) block = {};
    add_pose_sums(sums, block.u, block.gradient);
  }
  double cost = 0;
  for (double sum : lane_sums) cost += sum;
  return cost;
}

// Costs and weights of eight lanes from their residuals. Returns whether an active one has none.
template <int N>
bool BundleCore<N>::score_block(int begin, Block& block, LargeArray<double>& lane_cost, double* lane_sums) {
  constexpr uint64_t kAll = 0x0101010101010101;
  uint64_t active;
  std::memcpy(&active, &active_[begin], sizeof(active));
  bool all_finite = true;
  for (double squared : block.squared) all_finite = all_finite && squared < INFINITY;
  bool loses = false;
  if (active != kAll || !all_finite) {
    for (int k = 0; k < kBlockLanes; ++k) {
      const bool finite = std::isfinite(block.squared[k]);
      is_lost_[begin + k] = active_[begin + k] && !finite;
      loses = loses || is_lost_[begin + k];
      if (!active_[begin + k] || !finite) clear_lane(block, k);
    }
  } else {
    std::memset(&is_lost_[begin], 0, kBlockLanes);
  }
  const bool is_weighted = !layout_.weight.empty();
  if (is_weighted) {
    for (int k = 0; k < kBlockLanes; ++k) block.squared[k] *= layout_.weight[begin + k];
  }
  const RobustLoss loss = loss_;
  if (loss.kind == RobustLoss::Kind::kNone) {
    for (double& weight : block.weight) weight = 1;
    for (int k = 0; k < kBlockLanes; ++k) lane_cost[begin + k] = 0.5 * block.squared[k];
  } else {
    for (int k = 0; k < kBlockLanes; ++k) {
      block.weight[k] = loss.weight(block.squared[k]);
      lane_cost[begin + k] = 0.5 * loss.cost(block.squared[k]);
    }
  }
  if (is_weighted) {
    for (int k = 0; k < kBlockLanes; ++k) block.weight[k] *= layout_.weight[begin + k];
  }
  for (int k = 0; k < kBlockLanes; ++k) lane_sums[k] += lane_cost[begin + k];
  return loses;
}

template <int N>
void BundleCore<N>::store_block(int begin, const Block& block) {
  for (int k = 0; k < kBlockLanes; ++k) {
    const ObservationLayout::Lane& lane = layout_.lanes[begin + k];
    store_point_terms(begin + k, block, k);
    if (lane.slot < 0) continue;
    double* cross = system_.cross(lane.slot);
    if (lane.opens_slot) {
      for (int c = 0; c < 3; ++c) {
        for (int r = 0; r < N; ++r) cross[cross_place<N>(r, c)] = block.cross[N * c + r][k];
      }
    } else {
      for (int c = 0; c < 3; ++c) {
        for (int r = 0; r < N; ++r) cross[cross_place<N>(r, c)] += block.cross[N * c + r][k];
      }
    }
  }
}

// One thread adds them up at once, in the order of the lanes, as sum_points() does.
template <int N>
void BundleCore<N>::store_point_terms(int lane, const Block& block, int k) {
  if (!point_terms_.empty()) {
    double* terms = &point_terms_[9 * static_cast<size_t>(lane)];
    for (int c = 0; c < 9; ++c) terms[c] = block.point[c][k];
    return;
  }
  const int p = layout_.lanes[lane].system_point;
  if (p < 0) return;
  PointBlock& point = system_.point(p);
  for (int c = 0; c < 6; ++c) point.v[c] += block.point[c][k];
  for (int c = 0; c < 3; ++c) point.gradient[c] += block.point[6 + c][k];
}

template <int N>
void BundleCore<N>::clear_points() {
  for (int p = 0; p < system_.point_count(); ++p) system_.point(p) = {};
}

template <int N>
void BundleCore<N>::sum_points(int begin, int end) {
  for (int p = begin; p < end; ++p) {
    double sum[9] = {};
    for (int k = layout_.lane_begin[p]; k < layout_.lane_begin[p + 1]; ++k) {
      const double* terms = &point_terms_[9 * static_cast<size_t>(layout_.lanes_of_point[k])];
      for (int c = 0; c < 9; ++c) sum[c] += terms[c];
    }
    PointBlock& point = system_.point(p);
    std::copy_n(sum, 6, point.v);
    std::copy_n(sum + 6, 3, point.gradient);
  }
}

template class BundleCore<6>;
template class BundleCore<9>;

}  // namespace raysfm
