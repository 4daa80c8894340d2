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
  // Whether a step that promises less than min_relative_decrease is tried all the same before the end.
  bool try_last_step = true;
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
  bool settled = false;  // it is the last that is worth taking, whatever it promises
};

// Cost before and after a step, over the same set of observations; `after` is infinite for a step that must
// not be taken.
struct LmTrial {
  double before = 0;
  double after = 0;
  bool linearized = false;  // the normal equations are now those of the moved state
};

// Lambda by Nielsen's rule: it falls as well as the quadratic model held, and grows faster and faster while
// steps are refused.
class NielsenDamping {
 public:
  explicit NielsenDamping(double lambda) : lambda_(lambda) {}

  double lambda() const { return lambda_; }
  // No step has been refused since the last that was accepted.
  bool is_first_try() const { return growth_ == kFirstGrowth; }
  // `gain`: the decrease of the cost, of what the model promised.
  void accepted(double gain) {
    const double excess = 2.0 * gain - 1.0;
    lambda_ = std::max(kLeast, lambda_ * std::max(1.0 / 3.0, 1.0 - excess * excess * excess));
    growth_ = kFirstGrowth;
  }
  // False when lambda is so large that no step is left.
  bool refused() {
    lambda_ *= growth_;
    growth_ *= 2.0;
    return lambda_ <= kMost;
  }

 private:
  static constexpr double kLeast = 1e-10, kMost = 1e12, kFirstGrowth = 2.0;
  double lambda_, growth_ = kFirstGrowth;
};

// Levenberg-Marquardt minimisation with Marquardt's scaling of the damping (lambda times the diagonal of the
// normal equations) and Nielsen's update of lambda. The cost never rises. `Problem` owns the state:
//   double linearize()            normal equations at the current state; returns the cost there
//   LmStep solve(double lambda)   step of the damped system
//   LmTrial evaluate(bool linearize)  cost of the current state moved by the step; with `linearize` also the
//                                 normal equations there, in place of those of the current state, unless the
//                                 problem sees that the step will be refused
//   void accept()                 makes the moved state the current one
// Most steps are accepted, and cost and derivatives share most of their work: they are computed together
// unless the step is expected to be the last.
template <typename Problem>
LmSummary levenberg_marquardt(Problem& problem, const LmOptions& options) {
  LmSummary summary;
  double cost = problem.linearize();
  summary.initial_cost = summary.final_cost = cost;
  if (!(cost > 0) || !std::isfinite(cost)) {
    summary.termination = cost == 0 ? Termination::kConverged : Termination::kNoProgress;
    return summary;
  }
  summary.termination = Termination::kMaxIterations;
  NielsenDamping damping(options.initial_damping);
  bool equations_are_current = true;
  while (summary.iterations < options.max_iterations) {
    if (!equations_are_current) problem.linearize();
    ++summary.iterations;
    const LmStep step = problem.solve(damping.lambda());
    // Heavily damped after a refusal, a step may be small without the bottom being near.
    const bool first_try = damping.is_first_try();
    const bool promises_little =
        first_try && step.valid && (step.settled || step.decrease <= options.min_relative_decrease * cost);
    if (promises_little && !options.try_last_step) {
      summary.termination = Termination::kConverged;
      break;
    }
    const bool goes_on = !promises_little && summary.iterations < options.max_iterations;
    const LmTrial trial = step.valid ? problem.evaluate(goes_on) : LmTrial{cost, INFINITY};
    const bool accepted = trial.after <= trial.before;  // false for NaN
    equations_are_current = trial.linearized == accepted;
    if (accepted) {
      problem.accept();
      summary.final_cost = cost = trial.after;
    }
    const IterationInfo info{summary.iterations, cost, damping.lambda(), accepted};
    if (options.progress && *options.progress && !(*options.progress)(info)) {
      summary.termination = Termination::kInterrupted;
      break;
    }
    // A refused step that promised little: at the bottom, as far as doubles can tell.
    const double decrease = trial.before - trial.after;
    const bool gained_little =
        first_try && (step.settled || decrease <= options.min_relative_decrease * trial.before);
    if (accepted ? gained_little : promises_little) {
      summary.termination = Termination::kConverged;
      break;
    }
    if (accepted) {
      damping.accepted(decrease / step.decrease);
    } else if (!damping.refused()) {
      summary.termination = Termination::kNoProgress;
      break;
    }
  }
  return summary;
}

}  // namespace raysfm
