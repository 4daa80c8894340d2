#include "raysfm/bundle/problem_cost.h"

#include "raysfm/bundle/residual.h"
#include "raysfm/core/random.h"

namespace raysfm {

ProblemCost problem_cost(const BundleProblem& problem, const RobustLoss& loss) {
  ProblemCost result;
  ProblemResiduals residuals;
  residuals.load(problem);
  for (size_t i = 0; i < problem.observations.size(); ++i) {
    if (!problem.uses(i)) continue;
    Eigen::Vector2d residual;
    if (residuals(static_cast<int>(i), &residual)) {
      result.cost += 0.5 * loss.cost(residual.squaredNorm());
      ++result.used;
    } else {
      ++result.dropped;
    }
  }
  return result;
}

bool scale_is_observed(const BundleProblem& problem) {
  constexpr int kSamples = 500;
  constexpr double kFactor = 1.01, kRounding = 1e-9;  // pixels or radians
  if (problem.observations.empty()) return false;
  Rng rng(1);
  for (int sample = 0; sample < kSamples; ++sample) {
    const int i = static_cast<int>(rng.index(static_cast<uint32_t>(problem.observations.size())));
    const BundleObservation& o = problem.observations[i];
    Rigid3 scaled = problem.rig_from_world[o.pose];
    scaled.translation *= kFactor;
    const BalLens lens = problem.lenses.empty() ? BalLens{} : problem.lenses[o.pose];
    Eigen::Vector2d before, after;
    if (!residual_of(problem, i, &before) ||
        !residual_of(problem, i, scaled, lens, kFactor * problem.points[o.point], &after)) {
      continue;
    }
    if ((after - before).norm() > kRounding * (1.0 + before.norm())) return true;
  }
  return false;
}

}  // namespace raysfm
