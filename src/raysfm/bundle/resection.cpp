#include "raysfm/bundle/resection.h"

#include <vector>

namespace raysfm {

BundleSummary resect(BundleProblem problem, const BundleOptions& options, BundleAdjuster* adjuster) {
  const std::vector<uint8_t> all_fixed(problem.points.size(), 1);
  problem.point_is_fixed = all_fixed;
  return adjuster->adjust(problem, options);
}

BundleSummary intersect(BundleProblem problem, const BundleOptions& options, BundleAdjuster* adjuster) {
  const std::vector<uint8_t> none_free(problem.rig_from_world.size(), 0);
  problem.pose_is_free = none_free;
  return adjuster->adjust(problem, options);
}

}  // namespace raysfm
