#pragma once

#include <memory>

#include "raysfm/bundle/bundle_problem.h"

namespace raysfm {

// Bundle adjustment of rig poses and points under the pixel or the angular error: Levenberg-Marquardt on the
// normal equations with the points eliminated (LBA09 appendix A; optim/schur_system.h draws them). Keep one
// adjuster and give it one window after another: its memory only grows, and a window no larger than an
// earlier one allocates nothing.
//
// Nothing needs to be fixed: the damping takes care of the seven free directions of the gauge.
//
// An observation whose point does not project (behind the camera, outside the valid set of the model, not
// finite) is dropped and counted, never scored as zero. When a step would make a point leave a view, that
// point takes a quarter of its step, or none; what still does not project is dropped, and the step is judged
// on the observations that it keeps. A step that would lose more than one in fifty is refused.
//
// Contradictory sizes or indices give Termination::kInvalidProblem and change nothing. Values that are not
// finite do no harm: their observations are dropped.
class BundleAdjuster {
 public:
  BundleAdjuster();
  ~BundleAdjuster();
  BundleAdjuster(BundleAdjuster&&) noexcept;
  BundleAdjuster& operator=(BundleAdjuster&&) noexcept;

  // One series of iterations over the inliers. Leaves is_inlier alone.
  BundleSummary adjust(const BundleProblem& problem, const BundleOptions& options);

  // Two series of iterations with an update of the inliers after each (LBA09 2.5). problem.is_inlier must not
  // be empty. The summary spans both: the initial cost of the first, the final cost of the second, the sum of
  // the iterations and times, the drops of the second.
  BundleSummary adjust_two_stage(const BundleProblem& problem, const BundleOptions& options,
                                 double inlier_threshold) {
    return adjust_two_stage(problem, options, options, inlier_threshold);
  }
  // The same with options for each series; the loss and the threads are those of the first.
  BundleSummary adjust_two_stage(const BundleProblem& problem, const BundleOptions& first_options,
                                 const BundleOptions& second_options, double inlier_threshold);

 private:
  class Workspace;
  std::unique_ptr<Workspace> workspace_;
};

// Sets is_inlier of every observation to whether its residual is at most the threshold (in the unit of the
// residual), whatever it was before: observations that fit again come back. Those that have no residual are
// outliers. Returns the number of inliers.
int update_inliers(const BundleProblem& problem, double inlier_threshold);

}  // namespace raysfm
