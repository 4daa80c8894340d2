#include "raysfm/mapping/scale_keeper.h"

#include <cmath>

#include "raysfm/bundle/bundle_methods.h"
#include "raysfm/bundle/scale_estimate.h"
#include "raysfm/bundle/scale_search.h"
#include "raysfm/uncertainty/scale_uncertainty.h"

namespace raysfm {
namespace {

constexpr double kHold = 1e4;         // weight of the prior
constexpr double kTold = 0.2;         // stated sigma below which a scale counts as told
constexpr double kBetter = 0.5;       // sigma below which a measurement is better than the guess of a start
constexpr double kContradiction = 3;  // standard deviations of the inverse of the scale
// Factor to the standard deviation that the observations show: surfaces that do not face the camera, and the
// light on them, shift a patch for as long as it is followed. The rendered films of docs/results/rig_scale.md
// need about 1.2; the rest is for real ones.
constexpr double kUnmodelled = 2;
// Standard deviation of a scale as far as calibrations are right: baselines, which no footage tells.
constexpr double kCalibration = 0.005;
constexpr double kSettledScale = 0.25;  // of sigma: smaller steps are not worth taking
// Steps of the scale that need no adjustment of everything else. Where cameras are two decimetres apart, 1 %
// moves what is ten metres away by a fifth of a thousandth of a radian.
constexpr double kSmall = 0.01;
// Beyond it one linearisation is not believed, and a quick measurement searches too.
constexpr double kLarge = 0.5;
constexpr int kQuickSteps = 5;    // of each adjustment of a quick search
constexpr int kQuickPoints = 80;  // of each key frame, by which it goes
constexpr int kEvery = 2;         // key frames of a small map
constexpr double kGrowth = 1.25;  // of a large one, from measurement to measurement
// Key frames of a map that is no longer measured while it grows: what is told by then is told to a percent,
// or to what the errors of the rays leave, and to measure more takes ever longer.
constexpr int kMostMeasured = 300;
// Key frames above which a new scale does not wait for everything to be adjusted along with it.
constexpr size_t kQuicklyMeasured = 40;

// Infinite where the scale does not count as told. `by_calibration`: what the errors of what is known of the
// calibration make of it.
double stated(double sigma, double by_calibration) {
  const double all = std::hypot(kUnmodelled * sigma, kCalibration, by_calibration);
  return all < kTold ? all : INFINITY;
}

// Whether the observations contradict the present scale, though they do not tell a better one well: a guess
// far too large makes a camera of many viewpoints one of a single viewpoint, and bends the world.
bool is_far_off(const ScaleEstimate& found) {
  const double inverse = 1 / found.ratio;
  return std::abs(inverse - 1) > kContradiction * found.sigma * inverse;
}

}  // namespace

void hold_scale(const Map& map, std::span<const int> pose_of_keyframe, BundleProblem* problem) {
  if (map.guessed_keyframe < 0 || pose_of_keyframe[0] < 0) return;
  problem->scale_prior = {pose_of_keyframe[map.guessed_keyframe], pose_of_keyframe[0], map.guessed_distance,
                          kHold};
}

void measure_scale(const ScaleMeasure& how, const TrackingRig& rig, BundleProblem problem,
                   BundleAdjuster& adjuster, Map* map) {
  const bool is_by_heart = how.deviations.empty();
  std::vector<Eigen::Vector2d> by_residual;
  const std::optional<ScaleEstimate> found =
      estimate_scale(problem, how.options, is_by_heart ? nullptr : &by_residual);
  map->scale_sigma = INFINITY;
  if (!found || !(found->sigma < kBetter || is_far_off(*found))) return;
  const double by_calibration =
      is_by_heart ? 0 : scale_sigma_by_calibration(problem, by_residual, rig, how.deviations);
  map->scale_sigma = stated(found->sigma, by_calibration);
  const double step = std::abs(std::log(found->ratio));
  if (step < kSettledScale * found->sigma) return;
  const Eigen::Vector3d center = problem.rig_from_world[0].inverse().translation;
  const bool is_quick = how.effort == ScaleEffort::kQuick;
  double ratio = found->ratio;
  if (step < (is_quick ? kLarge : kSmall)) {
    scale_world(ratio, center, problem.rig_from_world, problem.points);
  } else {
    const int last = static_cast<int>(problem.rig_from_world.size()) - 1;
    const double distance = (problem.rig_from_world[last].inverse().translation - center).norm();
    problem.scale_prior = {last, 0, distance, kHold};
    BundleOptions steps = how.options;
    if (is_quick) steps.max_iterations = kQuickSteps;
    const ScaleSearch searched = is_quick ? search_scale_thinned(adjuster, problem, steps, kQuickPoints)
                                          : search_scale(adjuster, problem, steps);
    ratio = searched.distance / distance;
    map->scale_sigma = stated(searched.sigma, by_calibration);
  }
  map->rescaled *= ratio;
  map->guessed_distance *= ratio;
}

ScaleEffort effort_while_growing(const Map& map) {
  return map.keyframes.size() > kQuicklyMeasured ? ScaleEffort::kQuick : ScaleEffort::kFull;
}

bool is_scale_due(int keyframes, int global_until) {
  if (keyframes > kMostMeasured) return false;
  if (keyframes <= global_until) return keyframes % kEvery == 0;
  double due = std::max(1, global_until);
  while (static_cast<int>(due) < keyframes) due = std::max(due + 1, kGrowth * due);
  return static_cast<int>(due) == keyframes;
}

}  // namespace raysfm
