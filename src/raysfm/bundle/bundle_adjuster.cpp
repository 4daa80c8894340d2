#include "raysfm/bundle/bundle_adjuster.h"

#include <algorithm>
#include <optional>

#include "raysfm/bundle/bundle_core.h"
#include "raysfm/bundle/residual.h"
#include "raysfm/core/timer.h"

namespace raysfm {

namespace {

int mark_inliers(const BundleProblem& problem, double threshold, ProblemResiduals* residuals) {
  int inliers = 0;
  residuals->load(problem);
  const size_t count = std::min(problem.observations.size(), problem.is_inlier.size());
  for (size_t i = 0; i < count; ++i) {
    Eigen::Vector2d residual;
    const bool fits =
        (*residuals)(static_cast<int>(i), &residual) && residual.squaredNorm() <= threshold * threshold;
    problem.is_inlier[i] = fits;
    inliers += fits;
  }
  return inliers;
}

}  // namespace

// One state of each kind, made when the first problem of its kind comes.
class BundleAdjuster::Workspace {
 public:
  BundleSummary adjust(const BundleProblem& problem, const BundleOptions& options) {
    if (!problem.lenses.empty()) return adjust_with(with_lenses_, problem, options);
    return adjust_with(poses_, problem, options);
  }
  void mark(const BundleProblem& problem, double threshold) { mark_inliers(problem, threshold, &residuals_); }

 private:
  template <int N>
  static BundleSummary adjust_with(std::optional<BundleCore<N>>& core, const BundleProblem& problem,
                                   const BundleOptions& options);

  std::optional<BundleCore<6>> poses_;
  std::optional<BundleCore<9>> with_lenses_;
  ProblemResiduals residuals_;
};

template <int N>
BundleSummary BundleAdjuster::Workspace::adjust_with(std::optional<BundleCore<N>>& core,
                                                     const BundleProblem& problem,
                                                     const BundleOptions& options) {
  BundleSummary summary;
  if (!core) core.emplace();
  if (core->load(problem, options)) {
    const LmSummary lm =
        levenberg_marquardt(*core, LmOptions{options.max_iterations, options.min_relative_decrease,
                                             options.initial_damping, &options.progress});
    core->store();
    summary.initial_cost = lm.initial_cost;
    summary.final_cost = lm.final_cost;
    summary.iterations = lm.iterations;
    summary.termination = core->used() > 0 ? lm.termination : Termination::kNothingToDo;
  }
  summary.used_observations = core->used();
  summary.dropped_observations = core->dropped();
  return summary;
}

BundleAdjuster::BundleAdjuster() : workspace_(std::make_unique<Workspace>()) {}
BundleAdjuster::~BundleAdjuster() = default;
BundleAdjuster::BundleAdjuster(BundleAdjuster&&) noexcept = default;
BundleAdjuster& BundleAdjuster::operator=(BundleAdjuster&&) noexcept = default;

BundleSummary BundleAdjuster::adjust(const BundleProblem& problem, const BundleOptions& options) {
  const Clock::time_point start = Clock::now();
  if (!is_valid(problem, options)) {
    BundleSummary summary;
    summary.termination = Termination::kInvalidProblem;
    return summary;
  }
  BundleSummary summary = workspace_->adjust(problem, options);
  summary.solve_ms = milliseconds_since(start);
  return summary;
}

BundleSummary BundleAdjuster::adjust_two_stage(const BundleProblem& problem,
                                               const BundleOptions& first_options,
                                               const BundleOptions& second_options, double inlier_threshold) {
  const Clock::time_point start = Clock::now();
  const BundleSummary first = adjust(problem, first_options);
  if (first.termination == Termination::kInvalidProblem || first.termination == Termination::kInterrupted) {
    return first;
  }
  workspace_->mark(problem, inlier_threshold);
  BundleSummary summary = adjust(problem, second_options);
  workspace_->mark(problem, inlier_threshold);
  summary.initial_cost = first.initial_cost;
  summary.iterations += first.iterations;
  summary.solve_ms = milliseconds_since(start);
  return summary;
}

int update_inliers(const BundleProblem& problem, double inlier_threshold) {
  ProblemResiduals residuals;
  return mark_inliers(problem, inlier_threshold, &residuals);
}

}  // namespace raysfm
