#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "raysfm/api/find_lens.h"
#include "raysfm/api/track.h"

namespace raysfm {

// Whether a lens for each frame gives all that a run with these settings is to give: saved maps are maps of
// one rig.
bool can_have_lenses(const TrackSettings& settings);

// Whether solve() does, of footage of so many key frames: a lens for each makes its time grow as their third
// power.
bool can_be_solved(const TrackSettings& settings, double keyframes);

// A stretch of a map that looks as if the camera zoomed: its key frames agree much better where each has a
// lens of its own (signs_of_zoom()). `reconstruction`: of one perspective camera. None where none does.
std::optional<ZoomedStretch> zoom_in_map(const Reconstruction& reconstruction);

// What there is to say of a stretch that looks so where the poses are those of one lens; empty without one.
std::string zoom_warning(const std::optional<ZoomedStretch>& stretch);

// The same footage by solve(), where that finds that the camera zooms. None where it finds one lens, none
// that is determined, or nothing at all.
std::optional<TrackResult> solved_zoom(const TrackSettings& settings, const TrackCallbacks& callbacks);

// Whether a lens for each image explains so much more than one that nothing else need speak for it.
bool is_clear_zoom(const TrackResult& solved);

// From what a video is tracked with the zoom undone. solve() is dear, and takes pixels to be square.
enum class ZoomRoute : uint8_t {
  kMap,           // what the map of one lens says of its key frames
  kMapThenSolve,  // of a lens that was given: solve() where the map is too bent by the zoom
  kSolveThenMap,  // of a lens that was found, by which the map may be bent throughout
};

// The same footage with a lens for each image, where that is better than what was tracked with one. None
// where nothing is, or when told to stop.
std::optional<TrackResult> better_by_zoom(const TrackSettings& settings, const TrackCallbacks& callbacks,
                                          const TrackResult& tracked, ZoomRoute route);

// What there is to say of a result with a lens for each image.
std::string zoom_range(const TrackResult& result);

// Whether a result with other lenses may take the place of one that was tracked: of the frames that have a
// pose there, and of those whose place is known, those that are missing are few.
bool reaches_enough(const TrackResult& solved, const Reconstruction& tracked);

}  // namespace raysfm
