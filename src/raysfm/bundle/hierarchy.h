#pragma once

#include "raysfm/bundle/bundle_methods.h"

namespace raysfm {

// What a hierarchical adjustment did.
struct HierarchyResult {
  int iterations = 0;
  bool interrupted = false;
};

// Divides the poses into halves of halves down to pieces, adjusts each piece by itself, and joins two halves
// by the similarity (or rigid motion, where the scale is observed) between the poses and points that they
// share, adjusting what is joined. The whole is left joined but not adjusted. Valid arguments.
HierarchyResult merge_pieces(const BundleProblem& problem, const BundleOptions& options,
                             const HierarchyOptions& hierarchy);

}  // namespace raysfm
