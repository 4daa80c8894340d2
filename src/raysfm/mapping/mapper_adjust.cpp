// How a map is adjusted.
#include <algorithm>
#include <cmath>

#include "raysfm/bundle/bundle_methods.h"
#include "raysfm/bundle/hierarchy.h"
#include "raysfm/bundle/residual.h"
#include "raysfm/mapping/mapper.h"

namespace raysfm {
namespace {

// Where the noise is not asked for.
constexpr RobustLoss kLoss{RobustLoss::Kind::kHuber, 1.0};
// A window is near its minimum: two steps tell the outliers, and the second stage goes on from there. One
// step does for accuracy but loses more of fr1-rpy; to end at a decrease of 1e-3 costs kitti00-small 5 %.
const BundleOptions kFirstSteps{.max_iterations = 2, .min_relative_decrease = 1e-4};
const BundleOptions kLocalAdjustment{.max_iterations = 5, .min_relative_decrease = 1e-4};
// Another calibration moves a map along its weakest directions, such as the scale along a path: that costs
// next to nothing and would take hundreds of steps if these were damped. With 1e-7 a path of 700 m kept half
// of a drift of its scale, with 1e-9 to 1e-13 none of it.
constexpr double kLittleDamping = 1e-10;
const BundleOptions kAdaptionStep{
    .max_iterations = 1, .min_relative_decrease = 1e-3, .initial_damping = kLittleDamping};
const BundleOptions kFirstAdaption{
    .max_iterations = 2, .min_relative_decrease = 1e-3, .initial_damping = kLittleDamping};
const BundleOptions kAdaption{
    .max_iterations = 5, .min_relative_decrease = 1e-4, .initial_damping = kLittleDamping};
const BundleOptions kFirstWholeAdaption{
    .max_iterations = 20, .min_relative_decrease = 1e-3, .initial_damping = kLittleDamping};
const BundleOptions kWholeAdaption{
    .max_iterations = 50, .min_relative_decrease = 1e-5, .initial_damping = kLittleDamping};
// Joint standard deviations of all poses, where small steps are those of points next to wrong matches. Only
// where loops hold the scale along a path: where it is all but free, small steps go on in one direction
// (kitti00-small ended at 0.51 % of the path in place of 0.15 after its last adjustment, at 0.32 after that
// to the last calibration).
constexpr double kSettled = 1;
// Points in each key frame that tell its pose, where all of them would take long: of a large map, and of the
// newest part that a calibration changes a little.
constexpr int kThinnedPoints = 80, kAdaptedPoints = 300;
// Up to N_f key frames everything moves: with each of the first, then with every fifth.
constexpr int kAlwaysGlobal = 10, kGlobalEvery = 5;
// Key frames to an adjustment, where tracking does not need one. With 1 kitti07-mono and kitti00-small are no
// better, and slower.
constexpr int kAdjustEvery = 2;
constexpr int kMinShared = 10;  // points that make an older key frame part of the window
constexpr int kMaxOlder = 20;

// Squared error of the worst inlier.
constexpr double kWorst = kInlierError * kInlierError;
// Part of that which observations cost in the mean where a few steps do not adapt a map: it may lose all
// points.
constexpr double kMostlyOff = 0.95;

BundleOptions with(const RobustLoss& loss, BundleOptions options) {
  options.loss = loss;
  return options;
}

BundleOptions settling(BundleOptions options) {
  options.settled = kSettled;
  return options;
}

}  // namespace

const BundleOptions Mapper::kAdjustment{.loss = kLoss, .max_iterations = 50, .min_relative_decrease = 1e-4};

// The newest key frames from `first_observed`, and older ones that see many of the window's points: a place
// seen again ties the window to where it was first.
void Mapper::choose_window(const Map& map, int first_observed) {
  const int count = static_cast<int>(map.keyframes.size());
  std::vector<int> shared(count, 0);
  for (const int t : window_.tracks) {
    for (const TrackObservation& o : map.tracks[t].observations) ++shared[o.keyframe];
  }
  std::vector<std::pair<int, int>> older;  // (points, key frame)
  for (int k = 0; k < first_observed; ++k) {
    if (shared[k] >= kMinShared) older.push_back({shared[k], k});
  }
  std::sort(older.begin(), older.end(), std::greater<>());
  older.resize(options_.paper_window ? 0 : std::min<size_t>(older.size(), kMaxOlder));
  window_.keyframes.clear();
  for (const auto& [points, k] : older) window_.keyframes.push_back(k);
  std::sort(window_.keyframes.begin(), window_.keyframes.end());
  for (int k = first_observed; k < count; ++k) window_.keyframes.push_back(k);
  window_.pose_of_keyframe.assign(count, -1);
  for (size_t i = 0; i < window_.keyframes.size(); ++i) {
    window_.pose_of_keyframe[window_.keyframes[i]] = static_cast<int>(i);
  }
}

// Of a window that is the whole map: arrays that grow by themselves leave holes of their size in the heap.
void Mapper::reserve_observations(const Map& map) {
  size_t count = 0;
  for (const int t : window_.tracks) count += map.tracks[t].observations.size();
  window_.observations.reserve(count);
  window_.sigmas.reserve(count);
  window_.sources.reserve(count);
  window_.inliers.reserve(count);
  if (rig_.angular()) window_.rays.reserve(count);
}

// The window as flat arrays.
void Mapper::gather(const Map* map, int first_observed, int first_free) {
  const int count = static_cast<int>(map->keyframes.size());
  window_.poses.clear();
  window_.free.clear();
  window_.points.clear();
  window_.tracks.clear();
  window_.observations.clear();
  window_.rays.clear();
  window_.sigmas.clear();
  window_.sources.clear();
  window_.inliers.clear();
  window_.point_of_track.resize(map->tracks.size(), -1);
  for (int k = first_free; k < count; ++k) {
    for (const int t : map->keyframes[k].tracks) {
      if (t < 0 || !map->tracks[t].triangulated || window_.point_of_track[t] >= 0) continue;
      window_.point_of_track[t] = static_cast<int>(window_.points.size());
      window_.points.push_back(map->tracks[t].position);
      window_.tracks.push_back(t);
    }
  }
  choose_window(*map, first_observed);
  for (const int k : window_.keyframes) {
    window_.poses.push_back(map->keyframes[k].rig_from_world);
    window_.free.push_back(k >= first_free && k > 0);  // the first key frame is the world
  }
  if (first_observed == 0) reserve_observations(*map);
  for (const int t : window_.tracks) {
    for (const TrackObservation& o : map->tracks[t].observations) {
      const int pose = window_.pose_of_keyframe[o.keyframe];
      if (pose < 0) continue;
      const MapKeyFrame& k = map->keyframes[o.keyframe];
      window_.observations.push_back(
          {pose, window_.point_of_track[t], k.cameras[o.feature], k.instant_pixel(o.feature).cast<double>()});
      window_.sigmas.push_back(octave_side(k.octaves[o.feature]));
      if (rig_.angular()) window_.rays.push_back(k.rays[o.feature]);
      window_.sources.push_back(o);
      window_.inliers.push_back(k.inliers[o.feature]);
    }
  }
}

BundleProblem Mapper::window_problem(const Map& map) {
  BundleProblem problem{.cameras = rig_.cameras(),
                        .rig_from_world = window_.poses,
                        .pose_is_free = window_.free,
                        .points = window_.points,
                        .point_is_fixed = {},
                        .observations = window_.observations,
                        .is_inlier = window_.inliers,
                        .rays = window_.rays,
                        .lenses = {},
                        .sigmas = window_.sigmas,
                        .scale_prior = {}};
  if (!rig_.central()) hold_scale(map, window_.pose_of_keyframe, &problem);
  return problem;
}

void Mapper::scatter(int first_free, Map* map) {
  const int count = static_cast<int>(map->keyframes.size());
  for (int k = first_free; k < count; ++k) {
    map->keyframes[k].rig_from_world = window_.poses[window_.pose_of_keyframe[k]];
  }
  for (size_t i = 0; i < window_.tracks.size(); ++i) {
    map->tracks[window_.tracks[i]].position = window_.points[i];
    window_.point_of_track[window_.tracks[i]] = -1;
  }
  for (size_t i = 0; i < window_.sources.size(); ++i) {
    map->keyframes[window_.sources[i].keyframe].inliers[window_.sources[i].feature] = window_.inliers[i];
  }
  // A position that fewer than two views support is no position.
  for (const int t : window_.tracks) {
    int support = 0;
    for (const TrackObservation& o : map->tracks[t].observations) {
      support += map->keyframes[o.keyframe].inliers[o.feature];
    }
    if (support < 2) map->tracks[t].triangulated = false;
  }
}

RobustLoss Mapper::loss_of(const BundleProblem& problem) const {
  return options_.departures.noise ? loss_for_noise(problem) : kLoss;
}

void Mapper::adjust(const LocalWindow& window, const BundleOptions& first, const BundleOptions& second,
                    Map* map) {
  gather(map, window.first_observed, window.first_free);
  const BundleProblem problem = window_problem(*map);
  const RobustLoss loss = loss_of(problem);
  adjuster_.adjust_two_stage(problem, with(loss, first), with(loss, second), kInlierError);
  scatter(window.first_free, map);
}

// What adjusted a whole large map takes twenty times its memory, and windows need little of that.
void Mapper::release_scratch(const Map& map) {
  if (map.keyframes.size() <= kLargeMap) return;
  adjuster_ = {};
  window_ = {};
}

bool Mapper::is_adjustment_due(Adjusting adjusting, int keyframes) const {
  return adjusting == Adjusting::kNow || options_.paper_window || keyframes <= kAlwaysGlobal ||
         keyframes % kAdjustEvery == 0;
}

void Mapper::adjust_locally(Map* map) {
  ScopedTimer timer(adjust_timing);
  const int count = static_cast<int>(map->keyframes.size());
  const bool all_is_due = options_.paper_window || count <= kAlwaysGlobal || count % kGlobalEvery == 0;
  adjust(
      local_window(count, {options_.free_cameras, options_.window, all_is_due ? options_.global_until : 0}),
      kFirstSteps, kLocalAdjustment, map);
}

void Mapper::adapt_window(const BundleProblem& problem, Adaption how) {
  const RobustLoss loss = loss_of(problem);
  const auto by_noise = [&](const BundleOptions& options) { return with(loss, options); };
  switch (how) {
    case Adaption::kThinned:
      raysfm::adjust_thinned(adjuster_, problem, by_noise(kAdaptionStep), by_noise(kAdaptionStep),
                             kInlierError, kAdaptedPoints);
      break;
    case Adaption::kTwoSeriesThinned:
      raysfm::adjust_thinned(adjuster_, problem, by_noise(kFirstAdaption), by_noise(kAdaption), kInlierError,
                             kThinnedPoints);
      break;
    case Adaption::kTwoSeries:
      adjuster_.adjust_two_stage(problem, by_noise(kFirstAdaption), by_noise(kAdaption), kInlierError);
      break;
    case Adaption::kToTheEnd:
      adjuster_.adjust_two_stage(problem, by_noise(kFirstWholeAdaption), by_noise(kWholeAdaption),
                                 kInlierError);
      break;
    case Adaption::kUntilSettled:
      adjuster_.adjust_two_stage(problem, by_noise(settling(kFirstWholeAdaption)),
                                 by_noise(settling(kWholeAdaption)), kInlierError);
      break;
  }
}

void Mapper::adapt_to_cameras(int first, Adaption how, Map* map) {
  for (MapKeyFrame& k : map->keyframes) renew_rays(rig_, &k);
  gather(map, std::max(0, first - options_.window), first);
  BundleProblem problem = window_problem(*map);
  if (rig_.central() && first == 0) problem.scale_prior = present_extent();
  const bool has_few_steps = how != Adaption::kToTheEnd && how != Adaption::kUntilSettled;
  const double most = kMostlyOff * kWorst * static_cast<double>(window_.observations.size());
  if (has_few_steps && truncated_cost(problem, kInlierError) > most) how = Adaption::kToTheEnd;
  const Rigid3 newest = window_.poses.back();
  const LargeArray<uint8_t> inliers = window_.inliers;
  adapt_window(problem, how);
  // Steps of little damping may go too far, and a few do not come to one that does not.
  if (has_few_steps && window_.poses.back().translation == newest.translation) {
    std::ranges::copy(inliers, window_.inliers.begin());
    adapt_window(problem, Adaption::kToTheEnd);
  }
  scatter(first, map);
  if (first == 0) release_scratch(*map);
}

void Mapper::adjust_to_noise(Map* map) {
  ScopedTimer timer(adjust_timing);
  gather(map, 0, 0);
  BundleProblem problem = window_problem(*map);
  if (rig_.central()) problem.scale_prior = present_extent();
  BundleOptions options = settling(kWholeAdaption);
  options.loss = redescending_loss_for_noise(problem);
  adjuster_.adjust(problem, options);
  update_inliers(problem, kInlierError);
  scatter(0, map);
  release_scratch(*map);
}

void Mapper::adjust_thinned(Map* map) {
  ScopedTimer timer(adjust_timing);
  gather(map, 0, 0);
  BundleProblem problem = window_problem(*map);
  if (rig_.central()) problem.scale_prior = present_extent();
  const RobustLoss loss = loss_of(problem);
  raysfm::adjust_thinned(adjuster_, problem, with(loss, settling(kFirstAdaption)),
                         with(loss, settling(kAdaption)), kInlierError, kThinnedPoints);
  scatter(0, map);
  release_scratch(*map);
}

// Holds the scale that nothing tells, which steps of little damping would change at random.
ScalePrior Mapper::present_extent() const {
  constexpr double kHold = 1e4;
  const Eigen::Vector3d first = window_.poses.front().inverse().translation;
  const double distance = (window_.poses.back().inverse().translation - first).norm();
  if (!(distance > 0)) return {};
  return {static_cast<int>(window_.poses.size()) - 1, 0, distance, kHold};
}

void Mapper::adjust_globally(Map* map) {
  ScopedTimer timer(adjust_timing);
  adjust({}, kAdjustment, kAdjustment, map);
  release_scratch(*map);
}

void Mapper::adjust_hierarchically(Map* map) {
  ScopedTimer timer(adjust_timing);
  gather(map, 0, 0);
  BundleProblem problem = window_problem(*map);
  const RobustLoss loss = loss_of(problem);
  merge_pieces(problem, with(loss, kAdjustment), {});
  // Pieces are joined as well as the few points at their ends tell: what that bent is along the weakest
  // directions. With damping, kitti00-small kept 0.4 m of it.
  if (rig_.central()) problem.scale_prior = present_extent();
  adjuster_.adjust_two_stage(problem, with(loss, kFirstWholeAdaption), with(loss, kWholeAdaption),
                             kInlierError);
  scatter(0, map);
  release_scratch(*map);
}

void Mapper::measure_scale(ScaleEffort effort, Map* map, std::span<const Rig> deviations) {
  if (rig_.central()) return;
  ScopedTimer timer(adjust_timing);
  gather(map, 0, 0);
  const BundleProblem problem = window_problem(*map);
  // One loss for all scales that are tried.
  const BundleOptions options = with(loss_of(problem), kAdjustment);
  raysfm::measure_scale(
      {effort == ScaleEffort::kUntilSettled ? settling(options) : options, effort, deviations}, rig_, problem,
      adjuster_, map);
  scatter(0, map);
  release_scratch(*map);
}

}  // namespace raysfm
