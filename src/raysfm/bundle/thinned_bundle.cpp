// adjust_thinned(): a large problem in a part of the time.
#include <algorithm>
#include <numeric>

#include "raysfm/bundle/bundle_methods.h"
#include "raysfm/bundle/observation_layout.h"
#include "raysfm/core/paged_memory.h"

namespace raysfm {
namespace {

// Of each series, when poses are held: nothing but a point's own observations holds it back.
constexpr int kPointSteps = 1;

// Points that were chosen, or those that were not, with what is seen of them: a problem of its own with the
// poses of the whole.
class PartOfPoints {
 public:
  PartOfPoints(const BundleProblem& whole, std::span<const uint8_t> is_chosen, bool chosen) : whole_(whole) {
    std::vector<int> number(whole.points.size(), -1);
    for (size_t p = 0; p < whole.points.size(); ++p) {
      if ((is_chosen[p] != 0) != chosen) continue;
      number[p] = static_cast<int>(point_ids_.size());
      point_ids_.push_back(static_cast<int>(p));
      points_.push_back(whole.points[p]);
      if (!whole.point_is_fixed.empty()) point_is_fixed_.push_back(whole.point_is_fixed[p]);
    }
    for (size_t i = 0; i < whole.observations.size(); ++i) {
      BundleObservation o = whole.observations[i];
      if (number[o.point] < 0) continue;
      o.point = number[o.point];
      ids_.push_back(static_cast<int>(i));
      observations_.push_back(o);
      is_inlier_.push_back(whole.uses(i));
      if (!whole.rays.empty()) rays_.push_back(whole.rays[i]);
      if (!whole.sigmas.empty()) sigmas_.push_back(whole.sigmas[i]);
    }
  }

  bool empty() const { return points_.empty(); }

  BundleProblem problem() {
    BundleProblem part = whole_;  // poses are those of the whole
    part.points = points_;
    part.point_is_fixed = point_is_fixed_;
    part.observations = observations_;
    part.is_inlier = is_inlier_;
    part.rays = rays_;
    part.sigmas = sigmas_;
    return part;
  }

  // Where they are now, and which observations fit.
  void store() const {
    for (size_t p = 0; p < point_ids_.size(); ++p) whole_.points[point_ids_[p]] = points_[p];
    for (size_t i = 0; i < ids_.size(); ++i) whole_.is_inlier[ids_[i]] = is_inlier_[i];
  }

 private:
  BundleProblem whole_;
  LargeArray<int> point_ids_, ids_;  // of points and observations in the whole
  LargeArray<Eigen::Vector3d> points_;
  LargeArray<uint8_t> point_is_fixed_, is_inlier_;
  LargeArray<BundleObservation> observations_;
  LargeArray<ObservedRay> rays_;
  LargeArray<float> sigmas_;
};

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
