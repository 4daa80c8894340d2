#include "raysfm/bundle/scale_search.h"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "raysfm/bundle/scale_estimate.h"

namespace raysfm {
namespace {

constexpr double kHold = 1e4;  // weight of the prior: the distance stays where it is told
constexpr int kMostRounds = 6;
constexpr double kUnknown = 1;    // sigma beyond which no scale is better than another
constexpr double kSettled = 0.1;  // of sigma: steps that small are not worth another adjustment
// Another scale than that of the beginning is believed where it is near, in standard deviations of the
// inverse of the scale, or where the logarithm of the odds is larger. A rig that does not turn tells no
// scale, but errors of its rotations look like turns: of twelve paths of 20 to 60 poses five made a scale of
// a tenth and less likelier, by up to 10. A rig that turns tells it by hundreds: the films of
// docs/results/rig_scale.md by 36 to 5000. Errors of a point that are alike count as one: then it takes the
// odds of four standard deviations (those films: 20 to 4000).
constexpr double kNear = 3, kSurely = 12, kSurelyOfPoints = 8;

// A world that was adjusted at a scale.
struct AdjustedWorld {
  AdjustedWorld() = default;
  AdjustedWorld(const BundleProblem& problem, const BundleSummary& adjusted, double its_distance)
      : rig_from_world(problem.rig_from_world.begin(), problem.rig_from_world.end()),
        points(problem.points.begin(), problem.points.end()),
        distance(its_distance),
        cost(adjusted.final_cost),
        used(adjusted.used_observations) {}

  void restore(const BundleProblem& problem) const {
    std::ranges::copy(rig_from_world, problem.rig_from_world.begin());
    std::ranges::copy(points, problem.points.begin());
  }
  // What it does not see any more does not make it better.
  bool fits_better_than(const AdjustedWorld& other) const { return cost < other.cost && used >= other.used; }
  // With the variance of its residuals.
  double log_odds_against(const AdjustedWorld& other) const {
    return (other.cost - cost) * std::max(1, used) / cost;
  }

  std::vector<Rigid3> rig_from_world;
  std::vector<Eigen::Vector3d> points;
  double distance = 0;
  double cost = 0;
  int used = 0;  // observations
};

}  // namespace

void scale_world(double factor, const Eigen::Vector3d& center, std::span<Rigid3> rig_from_world,
                 std::span<Eigen::Vector3d> points) {
  for (Rigid3& pose : rig_from_world) {
    const Eigen::Vector3d origin = center + factor * (pose.inverse().translation - center);
    pose.translation = -(pose.rotation * origin);
  }
  for (Eigen::Vector3d& point : points) point = center + factor * (point - center);
}

ScaleSearch search_scale(BundleAdjuster& adjuster, const BundleProblem& problem,
                         const BundleOptions& options) {
  BundleProblem held = problem;
  held.scale_prior.weight = kHold;
  const Eigen::Vector3d center = problem.rig_from_world[held.scale_prior.from].inverse().translation;
  ScaleSearch result{held.scale_prior.distance, INFINITY};
  AdjustedWorld first, best;
  BundleOptions all_steps = options;  // of all rounds
  all_steps.max_iterations = 0;
  double alike = 1;
  for (int round = 0; round < kMostRounds; ++round) {
    AdjustedWorld world(problem, adjuster.adjust(held, options), held.scale_prior.distance);
    all_steps.max_iterations += options.max_iterations;
    if (round == 0) {
      first = world;
    } else if (!world.fits_better_than(best)) {
      result.distance = best.distance;
      best.restore(problem);
      break;
    }
    best = std::move(world);
    const std::optional<ScaleEstimate> found = estimate_scale(held, options);
    result.sigma = found ? found->sigma : INFINITY;
    alike = found ? found->alike : 1;
    result.distance = held.scale_prior.distance;
    if (!(result.sigma < kUnknown)) break;
    scale_world(found->ratio, center, held.rig_from_world, held.points);
    result.distance = held.scale_prior.distance *= found->ratio;
    if (std::abs(std::log(found->ratio)) < kSettled * result.sigma) break;
  }
  const bool is_far = std::abs(result.distance / first.distance - 1) > kNear * result.sigma;
  if (!is_far) return result;
  // A world that is not at its minimum fits better after more steps, whatever its scale.
  const AdjustedWorld found(problem, {}, result.distance);
  first.restore(problem);
  held.scale_prior.distance = first.distance;
  first = AdjustedWorld(problem, adjuster.adjust(held, all_steps), first.distance);
  if (best.log_odds_against(first) < std::max(kSurely, kSurelyOfPoints * alike))
    return {first.distance, INFINITY};
  found.restore(problem);
  return result;
}

}  // namespace raysfm
