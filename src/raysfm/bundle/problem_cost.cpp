#include "raysfm/bundle/problem_cost.h"

#include <algorithm>

#include "raysfm/bundle/residual.h"

namespace raysfm {

ProblemCost problem_cost(const BundleProblem& problem, const RobustLoss& loss) {
  ProblemCost result;
  for (size_t i = 0; i < problem.observations.size(); ++i) {
    if (!problem.is_inlier.empty() && !problem.is_inlier[i]) continue;
    Eigen::Vector2d residual;
    if (residual_of(problem, static_cast<int>(i), &residual)) {
      result.cost += 0.5 * loss.cost(residual.squaredNorm());
      ++result.used;
    } else {
      ++result.dropped;
    }
  }
  return result;
}

bool scale_is_observed(const BundleProblem& problem) {
  constexpr size_t kMostSamples = 500;
  constexpr double kFactor = 1.01, kRounding = 1e-9;  // pixels or radians
  const size_t step = std::max<size_t>(1, problem.observations.size() / kMostSamples);
  for (size_t i = 0; i < problem.observations.size(); i += step) {
    const BundleObservation& o = problem.observations[i];
    Rigid3 scaled = problem.rig_from_world[o.pose];
    scaled.translation *= kFactor;
    const BalLens lens = problem.lenses.empty() ? BalLens{} : problem.lenses[o.pose];
    Eigen::Vector2d before, after;
    if (!residual_of(problem, static_cast<int>(i), &before) ||
        !residual_of(problem, static_cast<int>(i), scaled, lens, kFactor * problem.points[o.point], &after)) {
      continue;
    }
    if ((after - before).norm() > kRounding * (1.0 + before.norm())) return true;
  }
  return false;
}

}  // namespace raysfm
