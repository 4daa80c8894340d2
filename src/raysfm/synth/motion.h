#pragma once

#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "raysfm/core/result.h"
#include "raysfm/geometry/pose.h"
#include "raysfm/worlds/world.h"

namespace raysfm::synth {

// Pose of the rig (world_from_rig) as an exact function of time in seconds, twice continuously
// differentiable.
using Motion = std::function<Rigid3(double time)>;

// A motion as `synth --list` shows it.
struct MotionInfo {
  std::string_view name;
  std::string_view description;
};

// The motions that make_motion knows.
const std::vector<MotionInfo>& motion_list();

struct MotionOptions {
  std::string name;     // empty: the world's habit
  double duration = 0;  // seconds, positive; drive, loop, orbit and rotate reach their end then
  double length = 0;    // metres of `drive`, `walk`, `look`, `pan` and `straight`, positive
  uint64_t seed = 0;    // of the phases of swaying and shaking
  double zoom = 1;      // of the lens over the sequence, positive; `dolly` goes away by this factor
  double rounds = 1;    // of `loop`, positive
};

// Whether a motion goes as far as MotionOptions::length says: drive, walk, look, pan and straight.
bool has_length(std::string_view motion);

// `drive` goes the world's way on wheels, `walk` on foot, `look` turning to all sides, `pan` with one turn on
// the spot half-way; `straight` keeps its direction and does not turn at all; `loop` goes `rounds` times
// round the world's circuit; `handheld` stays about one place, like someone who shows a room; `orbit` goes
// round the world's centre and looks at it, `dolly` too but goes away as the lens zooms in; `rotate` turns
// once about the camera's centre, which does not move at all. Errors: unknown name; a length that `straight`
// has no room for.
Result<Motion> make_motion(const Stage& stage, const Habit& habit, const MotionOptions& options);

}  // namespace raysfm::synth
