#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <utility>
#include <vector>

#include "raysfm/eval/trajectory_error.h"
#include "raysfm/saved_map/saved_map.h"
#include "support/synth_views.h"

namespace raysfm::testing_support {

// The maps that a run through small_camera() left; its frames are those from `first` on, which are told by
// their timestamps.
inline SavedMap saved_maps(std::vector<Map> maps, int first) {
  SavedMap saved{{{small_camera()}}, {}};
  for (Map& map : maps) {
    SavedWorld& world = saved.worlds.emplace_back();
    for (MapKeyFrame& k : map.keyframes) {
      world.sources.push_back({static_cast<double>(first + k.frame), {}});
      k.frame = static_cast<int>(world.sources.size()) - 1;
    }
    world.map = std::move(map);
  }
  return saved;
}

// Error of the places of frames that are told by their timestamps, in percent of their path.
inline double percent_of_path(const Trajectory& estimate, const SynthViews& views) {
  Trajectory truth;
  truth.timestamps = estimate.timestamps;
  for (const double frame : truth.timestamps) {
    truth.world_from_cam.push_back(views.world_from_rig[static_cast<int>(frame)]);
  }
  const Result<Evaluation> error = evaluate(estimate, truth, {.alignment = Alignment::kSim3});
  EXPECT_TRUE(error) << error.error().message;
  return error ? error->percent_of_path() : INFINITY;
}

}  // namespace raysfm::testing_support
