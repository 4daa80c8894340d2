#pragma once

#include <filesystem>

#include "raysfm/core/result.h"
#include "raysfm/scene/reconstruction.h"

namespace raysfm {

// Writes which key frame sees which point where, `keyframe,camera,point,u,v` with all digits: lines of
// keyframes.txt, cameras of the rig and points of points.ply, each counted from 0. A world whose cameras
// COLMAP has says so in sparse/ beside it, and has no such file.
Result<void> write_observations_csv(const Reconstruction& world, const std::filesystem::path& path);

// Adds the observations of such a file to a world's key frames, which are the last `keyframes` ones of `r`,
// and its points, which begin at `first_point`. Errors: bad input, naming file and line.
Result<void> read_observations_csv(const std::filesystem::path& path, int keyframes, int first_point,
                                   Reconstruction* r);

}  // namespace raysfm
