#include "raysfm/bundle/bundle_adjuster.h"

#include <algorithm>
#include <optional>

#include "raysfm/bundle/bundle_core.h"
#include "raysfm/bundle/residual.h"
#include "raysfm/core/timer.h"

namespace raysfm {

namespace {

template <int N>
LmSummary minimise(BundleCore<N>& core, const BundleOptions& options) {
  return levenberg_marquardt(core, LmOptions{options.max_iterations, options.min_relative_decrease,
                                             options.initial_damping, &options.progress});
}

template <int N>
BundleSummary summary_of(const BundleCore<N>& core, const LmSummary& lm) {
  BundleSummary summary;
  summary.initial_cost = lm.initial_cost;
  summary.final_cost = lm.final_cost;
  summary.iterations = lm.iterations;
  summary.termination = core.used() > 0 ? lm.termination : Termination::kNothingToDo;
  summary.used_observations = core.used();
  summary.dropped_observations = core.dropped();
  return summary;
}

template <int N>
BundleSummary adjust_with(BundleCore<N>& core, const BundleProblem& problem, const BundleOptions& options) {
  LmSummary lm;
  if (core.load(problem, options)) {
    lm = minimise(core, options);
    core.store();
  }
  return summary_of(core, lm);
}

template <int N>
BundleSummary adjust_two_stage_with(BundleCore<N>& core, const BundleProblem& problem,
                                    const BundleOptions& first_options, const BundleOptions& second_options,
                                    double inlier_threshold) {
  const bool moves = core.load(problem, first_options, Taking::kAll);
  LmSummary first, second;
  if (moves) first = minimise(core, first_options);
  if (first.termination == Termination::kInterrupted) {
    core.store();
    return summary_of(core, first);
  }
  core.mark_inliers(inlier_threshold);
  if (moves) second = minimise(core, second_options);
  BundleSummary summary = summary_of(core, second);
  core.mark_inliers(inlier_threshold);
  if (moves) core.store();
  summary.initial_cost = first.initial_cost;
  summary.iterations += first.iterations;
  return summary;
}

}  // namespace

// One state of each kind, made when the first problem of its kind comes.
class BundleAdjuster::Workspace {
 public:
  // use(core) of the kind of the problem.
  template <typename Use>
  BundleSummary with_core(const BundleProblem& problem, Use use) {
    if (!problem.lenses.empty()) return use(made(with_lenses_));
    return use(made(poses_));
  }

 private:
  template <int N>
  static BundleCore<N>& made(std::optional<BundleCore<N>>& core) {
    if (!core) core.emplace();
    return *core;
  }

  std::optional<BundleCore<6>> poses_;
  std::optional<BundleCore<9>> with_lenses_;
};

BundleAdjuster::BundleAdjuster() : workspace_(std::make_unique<Workspace>()) {}
BundleAdjuster::~BundleAdjuster() = default;
BundleAdjuster::BundleAdjuster(BundleAdjuster&&) noexcept = default;
BundleAdjuster& BundleAdjuster::operator=(BundleAdjuster&&) noexcept = default;

BundleSummary BundleAdjuster::adjust(const BundleProblem& problem, const BundleOptions& options) {
  const Clock::time_point start = Clock::now();
  BundleSummary summary;
  summary.termination = Termination::kInvalidProblem;
  if (!is_valid(problem, options)) return summary;
  summary = workspace_->with_core(problem, [&](auto& core) { return adjust_with(core, problem, options); });
  summary.solve_ms = milliseconds_since(start);
  return summary;
}

BundleSummary BundleAdjuster::adjust_two_stage(const BundleProblem& problem,
                                               const BundleOptions& first_options,
                                               const BundleOptions& second_options, double inlier_threshold) {
  const Clock::time_point start = Clock::now();
  BundleSummary summary;
  summary.termination = Termination::kInvalidProblem;
  if (!is_valid(problem, first_options) || !is_valid(problem, second_options)) return summary;
  summary = workspace_->with_core(problem, [&](auto& core) {
    return adjust_two_stage_with(core, problem, first_options, second_options, inlier_threshold);
  });
  summary.solve_ms = milliseconds_since(start);
  return summary;
}

int update_inliers(const BundleProblem& problem, double inlier_threshold) {
  ProblemResiduals residuals;
  residuals.load(problem);
  int inliers = 0;
  const size_t count = std::min(problem.observations.size(), problem.is_inlier.size());
  for (size_t i = 0; i < count; ++i) {
    Eigen::Vector2d residual;
    const bool fits = residuals(static_cast<int>(i), &residual) &&
                      residual.squaredNorm() <= inlier_threshold * inlier_threshold;
    problem.is_inlier[i] = fits;
    inliers += fits;
  }
  return inliers;
}

}  // namespace raysfm
