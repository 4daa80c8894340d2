// adjust_thinned(): a large problem in a part of the time.
#include <algorithm>
#include <numeric>

#include "raysfm/bundle/bundle_methods.h"
#include "raysfm/bundle/observation_layout.h"
#include "raysfm/bundle/problem_part.h"

namespace raysfm {
namespace {

// Of each series, when poses are held: nothing but a point's own observations holds it back.
constexpr int kPointSteps = 1;

// Points that were not chosen go with the first pose that sees them.
void carry_points(const BundleProblem& problem, std::span<const uint8_t> is_chosen,
                  std::span<const Rigid3> before) {
  std::vector<int> first(problem.points.size(), -1);
  for (size_t i = 0; i < problem.observations.size(); ++i) {
    const BundleObservation& o = problem.observations[i];
    if (problem.uses(i) && (first[o.point] < 0 || o.pose < first[o.point])) first[o.point] = o.pose;
  }
  for (size_t p = 0; p < problem.points.size(); ++p) {
    const bool is_fixed = !problem.point_is_fixed.empty() && problem.point_is_fixed[p];
    if (is_chosen[p] || is_fixed || first[p] < 0) continue;
    problem.points[p] = problem.rig_from_world[first[p]].inverse() * (before[first[p]] * problem.points[p]);
  }
}

}  // namespace

std::vector<uint8_t> choose_points(const BundleProblem& problem, int per_pose) {
  const size_t points = problem.points.size();
  std::vector<int> begin(points + 1, 0);
  for (size_t i = 0; i < problem.observations.size(); ++i) {
    if (problem.uses(i)) ++begin[problem.observations[i].point + 1];
  }
  std::vector<int> order(points);
  std::iota(order.begin(), order.end(), 0);
  std::ranges::stable_sort(order, std::greater<>(), [&](int p) { return begin[p + 1]; });
  std::partial_sum(begin.begin(), begin.end(), begin.begin());
  std::vector<int> poses(begin.back()), place(begin.begin(), begin.end() - 1);
  for (size_t i = 0; i < problem.observations.size(); ++i) {
    if (problem.uses(i)) poses[place[problem.observations[i].point]++] = problem.observations[i].pose;
  }
  std::vector<uint8_t> is_chosen(points, 0);
  std::vector<int> seen(problem.rig_from_world.size(), 0);
  for (const int p : order) {
    const std::span<const int> seeing(poses.data() + begin[p], begin[p + 1] - begin[p]);
    if (seeing.size() < 2) break;
    is_chosen[p] = std::ranges::any_of(seeing, [&](int pose) { return seen[pose] < per_pose; });
    if (!is_chosen[p]) continue;
    for (const int pose : seeing) ++seen[pose];
  }
  return is_chosen;
}

BundleSummary adjust_thinned(BundleAdjuster& adjuster, const BundleProblem& problem,
                             const BundleOptions& first_options, const BundleOptions& second_options,
                             double inlier_threshold, int per_pose) {
  if (!is_valid(problem, first_options) || !is_valid(problem, second_options)) {
    return adjuster.adjust_two_stage(problem, first_options, second_options, inlier_threshold);
  }
  const std::vector<Rigid3> before(problem.rig_from_world.begin(), problem.rig_from_world.end());
  const std::vector<uint8_t> is_chosen = choose_points(problem, per_pose);
  BundleSummary summary;
  {
    PartOfPoints chosen(problem, is_chosen, true);
    summary = adjuster.adjust_two_stage(chosen.problem(), first_options, second_options, inlier_threshold);
    chosen.store();
  }
  carry_points(problem, is_chosen, before);
  PartOfPoints others(problem, is_chosen, false);
  if (others.empty()) return summary;
  const std::vector<uint8_t> all_held(problem.rig_from_world.size(), 0);
  BundleProblem points = others.problem();
  points.pose_is_free = all_held;
  points.scale_prior = {};
  BundleOptions steps = second_options;
  steps.max_iterations = kPointSteps;
  adjuster.adjust_two_stage(points, steps, steps, inlier_threshold);
  others.store();
  return summary;
}

}  // namespace raysfm
