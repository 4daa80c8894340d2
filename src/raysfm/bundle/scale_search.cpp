#include "raysfm/bundle/scale_search.h"

#include <cmath>

#include "raysfm/bundle/scale_estimate.h"

namespace raysfm {
namespace {

constexpr double kHold = 1e4;  // weight of the prior: the distance stays where it is told
constexpr int kMostRounds = 6;
constexpr double kUnknown = 1;    // sigma beyond which no scale is better than another
constexpr double kSettled = 0.1;  // of sigma: steps that small are not worth another adjustment

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
  for (int round = 0; round < kMostRounds; ++round) {
    adjuster.adjust(held, options);
    const std::optional<ScaleEstimate> found = estimate_scale(held, options);
    result.sigma = found ? found->sigma : INFINITY;
    if (!(result.sigma < kUnknown)) break;
    scale_world(found->ratio, center, held.rig_from_world, held.points);
    held.scale_prior.distance *= found->ratio;
    if (std::abs(std::log(found->ratio)) < kSettled * result.sigma) break;
  }
  result.distance = held.scale_prior.distance;
  return result;
}

}  // namespace raysfm
