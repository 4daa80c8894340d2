#pragma once

#include <filesystem>
#include <string>

#include "raysfm/core/result.h"
#include "raysfm/geometry/trajectory.h"
#include "raysfm/io/report_file.h"
#include "raysfm/scene/reconstruction.h"

namespace raysfm {

// World from rig of every frame that has a pose, or of the key frames, in time order.
Trajectory posed_frames(const Reconstruction& reconstruction);
Trajectory posed_keyframes(const Reconstruction& reconstruction);

// Creates the folder where it is missing and makes sure that files can be written to it. Errors: bad input,
// naming the folder and the cause.
Result<void> prepare_output_folder(const std::filesystem::path& folder);

// Creates the folder where it is missing and writes trajectory.txt, keyframes.txt, covariance.csv,
// points.ply, sparse/, config.yaml (`config`, as it is) and, last, report.json. Stops at the first file that
// cannot be written; the files before it are whole.
Result<void> write_output_folder(const Reconstruction& reconstruction, const Report& report,
                                 const std::string& config, const std::filesystem::path& folder);

}  // namespace raysfm
