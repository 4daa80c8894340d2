#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "raysfm/api/solve.h"
#include "raysfm/uncalibrated/point_tracks.h"

namespace raysfm {

// Point tracks over all frames of an input.
struct SolveInput {
  PointTracks tracks;                       // image: index into the vectors below
  std::vector<double> timestamps;           // strictly increasing
  std::vector<std::string> names;           // of the images
  std::vector<uint8_t> keyframe;            // 1: takes part in the start and the adjustment
  std::vector<std::array<uint8_t, 3>> rgb;  // of the points; empty: unknown
  std::vector<Eigen::Vector3d> structure;   // known positions of the points; empty: unknown
  bool interrupted = false;                 // ends where the caller asked to stop
};

// A file of tracks; every image is a key frame. Errors: bad input.
Result<SolveInput> tracks_from_file(const SolveSettings& settings, const SolveCallbacks& callbacks);

}  // namespace raysfm
