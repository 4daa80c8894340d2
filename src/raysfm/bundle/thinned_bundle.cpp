// A large problem in a part of the time.
#include <algorithm>
#include <numeric>

#include "raysfm/bundle/bundle_methods.h"
#include "raysfm/bundle/observation_layout.h"
#include "raysfm/bundle/problem_part.h"

namespace raysfm {
namespace {

// Of each series, when poses are held: nothing but a point's own observations holds it back.
constexpr int kPointSteps = 1;
// The same, where the scale has changed by much.
constexpr int kScaledPointSteps = 5;

// Points that were not chosen go with the first pose that sees them, in a world so many times as large.
void carry_points(const BundleProblem& problem, std::span<const uint8_t> is_chosen,
                  std::span<const Rigid3> before, double scale) {
  std::vector<int> first(problem.points.size(), -1);
  for (size_t i = 0; i < problem.observations.size(); ++i) {
    const BundleObservation& o = problem.observations[i];
    if (problem.uses(i) && (first[o.point] < 0 || o.pose < first[o.point])) first[o.point] = o.pose;
  }
  for (size_t p = 0; p < problem.points.size(); ++p) {
    const bool is_fixed = !problem.point_is_fixed.empty() && problem.point_is_fixed[p];
    if (is_chosen[p] || is_fixed || first[p] < 0) continue;
    const Eigen::Vector3d in_rig = before[first[p]] * problem.points[p];
    problem.points[p] = problem.rig_from_world[first[p]].inverse() * (scale * in_rig);
  }
}

std::vector<Rigid3> poses_of(const BundleProblem& problem) {
  return {problem.rig_from_world.begin(), problem.rig_from_world.end()};
}

// Steps of the points of a problem with all its poses held: adjust(points, steps).
template <typename Adjust>
void adjust_points(PartOfPoints part, BundleOptions steps, Adjust adjust) {
  if (part.empty()) return;
  BundleProblem points = part.problem();
  const std::vector<uint8_t> all_held(points.rig_from_world.size(), 0);
  points.pose_is_free = all_held;
  points.scale_prior = {};
  steps.settled = 0;
  adjust(points, steps);
  part.store();
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
  const std::vector<Rigid3> before = poses_of(problem);
  const std::vector<uint8_t> is_chosen = choose_points(problem, per_pose);
  BundleSummary summary;
  {
    PartOfPoints chosen(problem, is_chosen, true);
    summary = adjuster.adjust_two_stage(chosen.problem(), first_options, second_options, inlier_threshold);
    chosen.store();
  }
  carry_points(problem, is_chosen, before, 1);
  BundleOptions point_steps = second_options;
  point_steps.max_iterations = kPointSteps;
  adjust_points({problem, is_chosen, false}, point_steps,
                [&](const BundleProblem& points, const BundleOptions& steps) {
                  adjuster.adjust_two_stage(points, steps, steps, inlier_threshold);
                });
  return summary;
}

ScaleSearch search_scale_thinned(BundleAdjuster& adjuster, const BundleProblem& problem,
                                 const BundleOptions& options, int per_pose) {
  const std::vector<Rigid3> before = poses_of(problem);
  const std::vector<uint8_t> is_chosen = choose_points(problem, per_pose);
  ScaleSearch found;
  {
    PartOfPoints chosen(problem, is_chosen, true);
    found = search_scale(adjuster, chosen.problem(), options);
    chosen.store();
  }
  carry_points(problem, is_chosen, before, found.distance / problem.scale_prior.distance);
  BundleOptions point_steps = options;
  point_steps.max_iterations = kScaledPointSteps;
  adjust_points(
      {problem, is_chosen, false}, point_steps,
      [&](const BundleProblem& points, const BundleOptions& steps) { adjuster.adjust(points, steps); });
  return found;
}

}  // namespace raysfm
