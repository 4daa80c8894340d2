#include "raysfm/bundle/scale_search.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace raysfm {
namespace {

constexpr double kHold = 1e4;    // weight of the prior: the distance stays where it is told
constexpr double kFactor = 2;    // between the scales tried
constexpr int kMostSteps = 3;    // from the first scale, either way
constexpr double kFinest = 1.1;  // ratio of scales at which the search ends

// The world at one scale, everything else adjusted.
struct Trial {
  double log_scale = 0;
  double cost = INFINITY;
  int used = 0;
  std::vector<Rigid3> poses;
  std::vector<Eigen::Vector3d> points;
};

class Search {
 public:
  Search(BundleAdjuster& adjuster, const BundleProblem& problem, const BundleOptions& options)
      : adjuster_(adjuster), problem_(problem), options_(options) {
    start_.poses.assign(problem.rig_from_world.begin(), problem.rig_from_world.end());
    start_.points.assign(problem.points.begin(), problem.points.end());
  }

  // From another trial, scaled about the origin of the rig that does not move.
  Trial at(double log_scale, const Trial& near) {
    Trial trial = near;
    trial.log_scale = log_scale;
    const double factor = std::exp(log_scale - near.log_scale);
    const Eigen::Vector3d center = near.poses[problem_.scale_prior.from].inverse().translation;
    for (Rigid3& pose : trial.poses) {
      const Eigen::Vector3d origin = center + factor * (pose.inverse().translation - center);
      pose.translation = -(pose.rotation * origin);
    }
    for (Eigen::Vector3d& point : trial.points) point = center + factor * (point - center);
    BundleProblem held = problem_;
    held.rig_from_world = trial.poses;
    held.points = trial.points;
    held.scale_prior.distance *= std::exp(log_scale);
    held.scale_prior.weight = kHold;
    const BundleSummary summary = adjuster_.adjust(held, options_);
    trial.cost = summary.final_cost;
    trial.used = summary.used_observations;
    return trial;
  }

  const Trial& start() const { return start_; }

 private:
  BundleAdjuster& adjuster_;
  const BundleProblem& problem_;
  const BundleOptions& options_;
  Trial start_;
};

// Where a parabola through three costs at equal steps of the logarithm is lowest, in steps from the middle.
double vertex(double left, double middle, double right) {
  const double curvature = left - 2 * middle + right;
  return curvature > 0 ? std::clamp(0.5 * (left - right) / curvature, -1.0, 1.0) : 0;
}

}  // namespace

ScaleSearch search_scale(BundleAdjuster& adjuster, const BundleProblem& problem,
                         const BundleOptions& options) {
  const double step = std::log(kFactor);
  Search search(adjuster, problem, options);
  Trial middle = search.at(0, search.start());
  Trial smaller = search.at(-step, middle), larger = search.at(step, middle);
  for (int i = 0; i < kMostSteps && std::min(smaller.cost, larger.cost) < middle.cost; ++i) {
    if (smaller.cost < larger.cost) {
      larger = std::move(middle);
      middle = std::move(smaller);
      smaller = search.at(middle.log_scale - step, middle);
    } else {
      smaller = std::move(middle);
      middle = std::move(larger);
      larger = search.at(middle.log_scale + step, middle);
    }
  }
  for (double fine = step; fine > std::log(kFinest); fine /= 3) {
    const double shift = fine * vertex(smaller.cost, middle.cost, larger.cost);
    Trial lowest = search.at(middle.log_scale + shift, middle);
    if (lowest.cost < middle.cost) middle = std::move(lowest);
    smaller = search.at(middle.log_scale - fine / 3, middle);
    larger = search.at(middle.log_scale + fine / 3, middle);
  }
  const double half = search.at(middle.log_scale - std::log(2), middle).cost;
  const double twice = search.at(middle.log_scale + std::log(2), middle).cost;
  ScaleSearch result;
  const Trial& best = middle;
  const int unknowns = static_cast<int>(3 * problem.points.size() + 6 * problem.rig_from_world.size());
  const double variance = 2 * best.cost / std::max(1, 2 * best.used - unknowns);
  const double rise = 2 * (std::min(half, twice) - best.cost);
  if (variance > 0 && rise > 0) result.significance = std::sqrt(rise / variance);
  result.distance = problem.scale_prior.distance * std::exp(best.log_scale);
  std::copy(best.poses.begin(), best.poses.end(), problem.rig_from_world.begin());
  std::copy(best.points.begin(), best.points.end(), problem.points.begin());
  return result;
}

}  // namespace raysfm
