#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "raysfm/core/result.h"
#include "raysfm/merging/merge_maps.h"
#include "raysfm/saved_map/saved_map.h"
#include "raysfm/scene/reconstruction.h"

namespace raysfm {

// What `track` made of a part of a video: its result, and the map that it left (--save-map).
struct VideoPiece {
  std::string name;
  Reconstruction result;
  SavedMap map;
};

// Pieces of one video as one result.
struct JoinedPieces {
  Reconstruction result;  // every frame of every piece once
  SavedMap map;
  std::vector<MergedWorld>
      worlds;  // what became of those of the pieces, which are in the order of their times
};

// Joins pieces of one video that overlap: their maps by merge_maps(), and the frames of each go with its key
// frames. A frame of several pieces, known by its timestamp, comes from the one in which it is farthest from
// the ends. The map of a piece without a pose is not looked at. `seed` draws samples. Errors: bad input,
// where the cameras are not the same, a result was not made by `track`, or a map is that of another run; no
// reconstruction, where no piece has a pose.
Result<JoinedPieces> join_pieces(std::vector<VideoPiece> pieces, uint64_t seed);

}  // namespace raysfm
