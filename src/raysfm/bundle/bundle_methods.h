#pragma once

#include <cstdint>
#include <vector>

#include "raysfm/bundle/bundle_adjuster.h"
#include "raysfm/bundle/local_bundle.h"
#include "raysfm/bundle/scale_search.h"

namespace raysfm {

// Three ways to adjust a whole problem. Poses are taken to be in the order of the sequence.
enum class BundleMethod : uint8_t {
  kGlobal,        // everything at once
  kHierarchical,  // halves of halves first, merged by similarities, then everything at once (LBA09 2.6, [9])
  kLocal,         // the windows of LBA09 2.5 one after the other; never everything at once
};

struct HierarchyOptions {
  int piece = 20;   // poses; a sequence no longer than this is not divided; at least 2 * overlap
  int overlap = 3;  // poses that two halves share; at least 1
};

struct BundleMethodOptions {
  BundleOptions bundle = {};        // of every single adjustment
  HierarchyOptions hierarchy = {};  // kHierarchical
  LocalBundleOptions local = {};    // kLocal
};

// The costs of the summaries are those of the whole problem before and after; iterations, times and drops of
// all adjustments are added up, except that the drops are those of the last one where everything takes part.
// When options.progress stops an adjustment, the method ends there with Termination::kInterrupted.
BundleSummary adjust_globally(const BundleProblem& problem, const BundleOptions& options);
BundleSummary adjust_hierarchically(const BundleProblem& problem, const BundleOptions& options,
                                    const HierarchyOptions& hierarchy = {});
BundleSummary adjust_locally(const BundleProblem& problem, const BundleOptions& options,
                             const LocalBundleOptions& windows = {});
BundleSummary adjust(const BundleProblem& problem, BundleMethod method, const BundleMethodOptions& options);

// The points that hold the poses of a problem together best: those that most inliers show, so many that every
// pose sees `per_pose` of them, or all that it has. 1 for a point that is chosen. Valid problem.
std::vector<uint8_t> choose_points(const BundleProblem& problem, int per_pose);

// Adjusts a large problem in a part of the time: poses by the chosen points alone, in the two series of
// BundleAdjuster::adjust_two_stage(); all other points follow the first pose that sees them, and then each is
// adjusted by itself, with the poses held. Inliers of every observation are those of the result. The summary
// is that of the poses' adjustment. problem.is_inlier must not be empty.
BundleSummary adjust_thinned(BundleAdjuster& adjuster, const BundleProblem& problem,
                             const BundleOptions& first_options, const BundleOptions& second_options,
                             double inlier_threshold, int per_pose);

// search_scale() in a part of the time: by the chosen points alone, which all others follow as above, at the
// scale that was found. Which observations are inliers stays.
ScaleSearch search_scale_thinned(BundleAdjuster& adjuster, const BundleProblem& problem,
                                 const BundleOptions& options, int per_pose);

}  // namespace raysfm
