#pragma once

#include "raysfm/bundle/bundle_adjuster.h"

namespace raysfm {

// Refinement of one side alone (LBA09 3.3), by the solver of the whole.

// Poses (and lenses) with the points held: the poses do not touch each other.
BundleSummary resect(BundleProblem problem, const BundleOptions& options, BundleAdjuster* adjuster);

// Points with the poses and lenses held: the points do not touch each other.
BundleSummary intersect(BundleProblem problem, const BundleOptions& options, BundleAdjuster* adjuster);

}  // namespace raysfm
