#pragma once

#include <filesystem>

#include "raysfm/core/result.h"
#include "raysfm/scene/reconstruction.h"

namespace raysfm {

// Formats of the path of a world, with every frame that has a pose, in time order. None needs a camera model.

// trajectory.txt in TUM's form: seconds, position and quaternion (w last), world from the first camera.
Result<void> write_tum(const Reconstruction& world, const std::filesystem::path& folder);

// poses.txt, 12 numbers of the 3 x 4 matrix world from the first camera by rows; times.txt, their seconds;
// and frames.txt, the number of the frame of each line, since frames without a pose have none.
Result<void> write_kitti(const Reconstruction& world, const std::filesystem::path& folder);

// data.csv in the form of EuRoC's ground truth: whole nanoseconds, position and quaternion (w first), world
// from rig. Bad input where a timestamp does not fit.
Result<void> write_euroc(const Reconstruction& world, const std::filesystem::path& folder);

// points.ply: the points of the map, behind them the position of every camera of every frame with a pose, in
// red; comments of its header count them.
Result<void> write_ply(const Reconstruction& world, const std::filesystem::path& folder);

}  // namespace raysfm
