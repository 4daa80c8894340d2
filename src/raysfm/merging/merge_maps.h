#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "raysfm/core/result.h"
#include "raysfm/saved_map/saved_map.h"
#include "raysfm/scene/reconstruction.h"

namespace raysfm {

// A saved map with its name for messages.
struct NamedMap {
  std::string name;
  SavedMap map;
  std::vector<CalibrationNumber> calibration = {};  // how its cameras were refined
};

// A key frame of which the pose in another world is known as well: a run that made that world saw its very
// image.
struct KnownView {
  int map = 0, world = 0, keyframe = 0;
  int other_map = 0, other_world = 0;
  Rigid3 rig_from_other;
};

// What became of a world of a map that was merged.
struct MergedWorld {
  int map = 0, world = 0;  // which it was
  int into = -1;           // world of the merged map that has it; -1: it had no key frames
  int points = 0;          // by which it was recognised in a world before it; 0: it was not
};

// Several maps in one.
struct MergedMaps {
  SavedMap map;
  std::vector<MergedWorld> worlds;                // of all maps, in their order
  std::vector<CalibrationNumber> calibration;     // how its cameras were refined
  std::vector<std::vector<int>> map_of_keyframe;  // by world of `map`: which map its key frames come from
};

// Puts the worlds of maps into one map, through the cameras of the first. Worlds that show one place are
// joined and adjusted as `track` does it, and those that `known` views tell of; the others stay side by side.
// Where there are known views, the maps are of one video: their cameras are the same, however differently
// each was refined on what it saw. Those most like all others are taken; where they were refined, and a
// joined world has much more than any that was put into it, they are refined once more on that. `seed` draws
// samples. Errors: bad input, where the cameras are not the same.
Result<MergedMaps> merge_maps(std::vector<NamedMap> maps, uint64_t seed,
                              std::span<const KnownView> known = {});

}  // namespace raysfm
