#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <string_view>

namespace raysfm {

// Why a minimisation ended.
enum class Termination : uint8_t {
  kConverged,       // an accepted step lowered the cost by less than min_relative_decrease of it
  kMaxIterations,   // the last allowed step was still a good one
  kNoProgress,      // no damping gives a step that lowers the cost
  kNothingToDo,     // nothing free, or no usable observation
  kInvalidProblem,  // sizes or indices that contradict each other; nothing was changed
  kInterrupted,     // the progress callback asked to stop; the steps accepted until then are kept
};

constexpr std::string_view to_string(Termination termination) {
  switch (termination) {
    case Termination::kConverged:
      return "converged";
    case Termination::kMaxIterations:
      return "max iterations";
    case Termination::kNoProgress:
      return "no progress";
    case Termination::kNothingToDo:
      return "nothing to do";
    case Termination::kInvalidProblem:
      return "invalid problem";
    case Termination::kInterrupted:
      return "interrupted";
  }
  return "unknown";
}

// State after a linear solve and the trial of its step.
struct IterationInfo {
  int iteration = 0;   // from 1
  double cost = 0;     // of the best state so far
  double damping = 0;  // lambda of this solve
  bool accepted = false;
};

// Returns whether to go on.
using ProgressCallback = std::function<bool(const IterationInfo&)>;

struct LmOptions {
  int max_iterations = 10;              // linear solves, whether or not their step is accepted
  double min_relative_decrease = 1e-6;  // stop when an accepted step lowers the cost by less than this share
  double initial_damping = 1e-4;        // lambda, relative to the diagonal of the normal equations
  const ProgressCallback* progress = nullptr;  // null or empty: none
};

// How a minimisation went.
struct LmSummary {
  double initial_cost = 0;
  double final_cost = 0;
  int iterations = 0;  // linear solves
  Termination termination = Termination::kNothingToDo;
};

// What a step of the linearised problem promises: `decrease` is the cost lost by the quadratic model.
struct LmStep {
  bool valid = false;  // false: the damped system is not positive definite
  double decrease = 0;
};

// Cost before and after a step, over the same set of observations; `after` is infinite for a step that must
// not be taken.
struct LmTrial {
  double before = 0;
  double after = 0;
};

// Levenberg-Marquardt minimisation with Marquardt's scaling of the damping (lambda times the diagonal of the
// normal equations) and Nielsen's update of lambda. The cost never rises. `Problem` owns the state:
//   double linearize()            normal equations at the current state; returns the cost there
//   LmStep solve(double lambda)   step of the damped system
//   LmTrial evaluate(bool linearize)  cost of the current state moved by the step; with `linearize` also the
//                                 normal equations there, in place of those of the current state
//   void accept()                 makes the moved state the current one
// Most steps are accepted, and cost and derivatives share most of their work: they are computed together
// unless the step is expected to be the last.
template <typename Problem>
LmSummary levenberg_marquardt(Problem& problem, const LmOptions& options) {
  constexpr double kMinDamping = 1e-10, kMaxDamping = 1e12, kFirstGrowth = 2.0;
  LmSummary summary;
  double cost = problem.linearize();
  summary.initial_cost = summary.final_cost = cost;
  if (!(cost > 0) || !std::isfinite(cost)) {
    summary.termination = cost == 0 ? Termination::kConverged : Termination::kNoProgress;
    return summary;
  }
  summary.termination = Termination::kMaxIterations;
  double damping = options.initial_damping, growth = kFirstGrowth;
  const auto go_on = [&](const IterationInfo& info) {
    return !options.progress || !*options.progress || (*options.progress)(info);
  };
  bool stale = false;  // the normal equations are not those of the current state
  while (summary.iterations < options.max_iterations) {
    if (stale) problem.linearize();
    ++summary.iterations;
    const LmStep step = problem.solve(damping);
    // Heavily damped after a refusal, a step may be small without the bottom being near.
    const bool first_try = growth == kFirstGrowth;
    const bool at_bottom = first_try && step.valid && step.decrease <= options.min_relative_decrease * cost;
    const bool ahead = !at_bottom && summary.iterations < options.max_iterations;
    const LmTrial trial = step.valid ? problem.evaluate(ahead) : LmTrial{cost, INFINITY};
    const bool accepted = trial.after <= trial.before;  // false for NaN
    stale = accepted ? !ahead : ahead && step.valid;
    if (accepted) {
      problem.accept();
      summary.final_cost = cost = trial.after;
    }
    if (!go_on({summary.iterations, cost, damping, accepted})) {
      summary.termination = Termination::kInterrupted;
      break;
    }
    if (accepted) {
      const double decrease = trial.before - trial.after;
      if (first_try && decrease <= options.min_relative_decrease * trial.before) {
        summary.termination = Termination::kConverged;
        break;
      }
      const double gain = 2.0 * decrease / step.decrease - 1.0;
      damping = std::max(kMinDamping, damping * std::max(1.0 / 3.0, 1.0 - gain * gain * gain));
      growth = kFirstGrowth;
    } else {
      if (at_bottom) {  // as far as doubles can tell
        summary.termination = Termination::kConverged;
        break;
      }
      damping *= growth;
      growth *= 2.0;
      if (damping > kMaxDamping) {
        summary.termination = Termination::kNoProgress;
        break;
      }
    }
  }
  return summary;
}

}  // namespace raysfm
