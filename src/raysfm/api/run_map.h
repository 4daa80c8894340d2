#pragma once

#include <optional>

#include "raysfm/api/track.h"
#include "raysfm/saved_map/saved_map.h"

namespace raysfm {

// The saved maps of a run: the one that it goes on from, and the one that it leaves.
struct RunMaps {
  std::optional<SavedMap> known;
  std::optional<SavedMapWriter> writer;  // holds its file until the end
};

// Where a map is to be left, what is far lies beside it from now on. Errors: bad input, where the settings
// contradict each other, a map cannot be read, or another run holds the one to be written.
Result<RunMaps> open_maps(const TrackSettings& settings, const EventSink& event);

// The cameras as the known map has them, which may be better known than those given; these must be as many
// and of the same sizes. Errors: bad input.
Result<Rig> cameras_of_map(const TrackSettings& settings, const SavedMap& known, Rig given);

// The maps, for the tracker; `known` keeps what only the file has.
std::vector<Map> take_worlds(SavedMap* known);

// Writes what a run leaves: `maps` are those of Tracker::finish(). Does nothing where none was asked for, or
// there is nothing to write.
Result<void> save_maps(const RunMaps& run, const Reconstruction& reconstruction, std::vector<Map> maps);

}  // namespace raysfm
