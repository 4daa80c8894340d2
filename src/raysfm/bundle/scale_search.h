#pragma once

#include "raysfm/bundle/bundle_adjuster.h"

namespace raysfm {

struct ScaleSearch {
  double distance = 0;      // between the two poses of the prior, at the scale of least cost
  double significance = 0;  // standard deviations by which half and double that scale fit worse, the lesser
};

// The scale of a world that is seen along rays of different origins, where it is so weak an unknown among the
// others that an adjustment would not find it: the cost, everything else adjusted, is followed along the
// scale to its minimum, and poses and points are left there. problem.scale_prior names two poses, its `from`
// not free and its distance where the search begins; nothing else may be fixed. The search goes no farther
// than a factor of about ten either way. Not for cameras whose rays all meet: any scale would do.
ScaleSearch search_scale(BundleAdjuster& adjuster, const BundleProblem& problem,
                         const BundleOptions& options);

}  // namespace raysfm
