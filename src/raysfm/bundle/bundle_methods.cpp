#include "raysfm/bundle/bundle_methods.h"

#include <algorithm>
#include <vector>

#include "raysfm/bundle/bundle_adjuster.h"
#include "raysfm/bundle/hierarchy.h"
#include "raysfm/bundle/observation_layout.h"
#include "raysfm/bundle/problem_cost.h"
#include "raysfm/bundle/problem_part.h"
#include "raysfm/core/timer.h"

namespace raysfm {
namespace {

BundleSummary invalid() {
  BundleSummary summary;
  summary.termination = Termination::kInvalidProblem;
  return summary;
}

void set_final(const BundleProblem& problem, const RobustLoss& loss, BundleSummary* summary) {
  const ProblemCost cost = problem_cost(problem, loss);
  summary->final_cost = cost.cost;
  summary->used_observations = cost.used;
  summary->dropped_observations = cost.dropped;
}

// What a problem was before it was adjusted part by part.
class Start {
 public:
  explicit Start(const BundleProblem& problem)
      : poses_(problem.rig_from_world.begin(), problem.rig_from_world.end()),
        lenses_(problem.lenses.begin(), problem.lenses.end()),
        points_(problem.points.begin(), problem.points.end()) {}

  // Stopped half-way, parts may fit each other worse than at the start.
  void restore_if_better(const BundleProblem& problem, const RobustLoss& loss, BundleSummary* summary) const {
    if (summary->termination != Termination::kInterrupted || summary->final_cost <= summary->initial_cost) {
      return;
    }
    std::copy(poses_.begin(), poses_.end(), problem.rig_from_world.begin());
    std::copy(lenses_.begin(), lenses_.end(), problem.lenses.begin());
    std::copy(points_.begin(), points_.end(), problem.points.begin());
    set_final(problem, loss, summary);
  }

 private:
  std::vector<Rigid3> poses_;
  std::vector<BalLens> lenses_;
  std::vector<Eigen::Vector3d> points_;
};

// Walks the windows along the sequence. Poses and points that no window has held yet follow the poses before
// them, as they would in odometry.
class LocalRun {
 public:
  LocalRun(const BundleProblem& problem, const BundleOptions& options)
      : problem_(problem),
        options_(options),
        by_pose_(problem),
        start_(problem.rig_from_world.begin(), problem.rig_from_world.end()),
        point_is_placed_(problem.points.size(), 0) {}

  // Adjusts the window that ends before pose `count`. False when it was interrupted.
  bool adjust_window(int count, const LocalWindow& window, BundleSummary* summary) {
    place(count - 1);
    part_.cut(problem_, by_pose_, window.first_observed, count, window.first_free, true);
    const BundleSummary result = adjuster_.adjust(part_.problem(), options_);
    part_.store(problem_);
    summary->iterations += result.iterations;
    return result.termination != Termination::kInterrupted;
  }

  // Lets the rest of the sequence follow.
  void place_from(int pose) {
    for (; pose < static_cast<int>(start_.size()); ++pose) place(pose);
  }

 private:
  void place(int pose) {
    const auto is_free = [&](int i) { return problem_.pose_is_free.empty() || problem_.pose_is_free[i]; };
    if (pose > 0 && is_free(pose)) {
      problem_.rig_from_world[pose] =
          start_[pose] * start_[pose - 1].inverse() * problem_.rig_from_world[pose - 1];
    }
    const Rigid3 now_from_start = problem_.rig_from_world[pose].inverse() * start_[pose];
    for (int k = by_pose_.begin[pose]; k < by_pose_.begin[pose + 1]; ++k) {
      const int p = problem_.observations[by_pose_.observations[k]].point;
      if (point_is_placed_[p]) continue;
      point_is_placed_[p] = 1;
      if (!problem_.point_is_fixed.empty() && problem_.point_is_fixed[p]) continue;
      problem_.points[p] = now_from_start * problem_.points[p];
    }
  }

  const BundleProblem& problem_;
  const BundleOptions& options_;
  ObservationsByPose by_pose_;
  std::vector<Rigid3> start_;
  std::vector<uint8_t> point_is_placed_;
  ProblemPart part_;
  BundleAdjuster adjuster_;
};

}  // namespace

BundleSummary adjust_globally(const BundleProblem& problem, const BundleOptions& options) {
  return BundleAdjuster().adjust(problem, options);
}

BundleSummary adjust_hierarchically(const BundleProblem& problem, const BundleOptions& options,
                                    const HierarchyOptions& hierarchy) {
  const Clock::time_point start = Clock::now();
  if (!is_valid(problem, options) || hierarchy.overlap < 1 || hierarchy.piece / 2 < hierarchy.overlap) {
    return invalid();
  }
  const Start before(problem);
  BundleSummary summary;
  summary.initial_cost = problem_cost(problem, options.loss).cost;
  const HierarchyResult result = merge_pieces(problem, options, hierarchy);
  summary.iterations = result.iterations;
  summary.termination = Termination::kInterrupted;
  if (!result.interrupted) {
    const BundleSummary last = adjust_globally(problem, options);
    summary.iterations += last.iterations;
    summary.termination = last.termination;
  }
  set_final(problem, options.loss, &summary);
  before.restore_if_better(problem, options.loss, &summary);
  summary.solve_ms = milliseconds_since(start);
  return summary;
}

BundleSummary adjust_locally(const BundleProblem& problem, const BundleOptions& options,
                             const LocalBundleOptions& windows) {
  const Clock::time_point start = Clock::now();
  if (!is_valid(problem, options) || !validate(windows)) return invalid();
  const Start before(problem);
  BundleSummary summary;
  summary.initial_cost = problem_cost(problem, options.loss).cost;
  summary.termination = problem.rig_from_world.empty() ? Termination::kNothingToDo : Termination::kConverged;
  LocalRun run(problem, options);
  for (int count = 1; count <= static_cast<int>(problem.rig_from_world.size()); ++count) {
    if (!run.adjust_window(count, local_window(count, windows), &summary)) {
      summary.termination = Termination::kInterrupted;
      run.place_from(count);
      break;
    }
  }
  set_final(problem, options.loss, &summary);
  before.restore_if_better(problem, options.loss, &summary);
  summary.solve_ms = milliseconds_since(start);
  return summary;
}

BundleSummary adjust(const BundleProblem& problem, BundleMethod method, const BundleMethodOptions& options) {
  switch (method) {
    case BundleMethod::kHierarchical:
      return adjust_hierarchically(problem, options.bundle, options.hierarchy);
    case BundleMethod::kLocal:
      return adjust_locally(problem, options.bundle, options.local);
    case BundleMethod::kGlobal:
      break;
  }
  return adjust_globally(problem, options.bundle);
}

}  // namespace raysfm
