#pragma once

#include "raysfm/bundle/bundle_adjuster.h"
#include "raysfm/scene/map.h"
#include "raysfm/views/tracking_rig.h"

namespace raysfm {

// The scale of a map of a rig whose rays have different origins. A start often does not tell it, and an
// adjustment would run along a valley that is nearly flat: what is guessed is held, and measured by what the
// map has seen since.

// Keeps a guessed scale where it is. `pose_of_keyframe` names the pose of each key frame of the map in the
// problem, -1 for none; nothing is held where the first key frame is not in it.
void hold_scale(const Map& map, std::span<const int> pose_of_keyframe, BundleProblem* problem);

// How a measurement that tells another scale is followed.
enum class ScaleEffort : uint8_t {
  kFull,          // everything is adjusted along with it
  kUntilSettled,  // the same, as far as poses are known: of a map that loops hold together
  kQuick,         // all but the largest steps are taken as they are: the rest has time
};

// How a map that grows is measured: a large one quickly.
ScaleEffort effort_while_growing(const Map& map);

// What a scale is measured by.
struct ScaleMeasure {
  BundleOptions options = {};
  ScaleEffort effort = ScaleEffort::kFull;
  // How well the calibration is known, as of window_covariance(); empty: by heart.
  std::span<const Rig> deviations = {};
};

// Measures the scale from a problem of the whole map of `rig`: poses are all its key frames in order, the
// first of which is not free. Where something tells the scale, poses and points of the problem go there;
// map->scale_sigma, `rescaled` and the guess are what changes of the map.
void measure_scale(const ScaleMeasure& how, const TrackingRig& rig, BundleProblem problem,
                   BundleAdjuster& adjuster, Map* map);

// Whether a map that grows is due for a measurement: one is worth an iteration of an adjustment of all of it,
// and so there are fewer and fewer, and none of the largest maps.
bool is_scale_due(int keyframes, int global_until);

}  // namespace raysfm
