#pragma once

#include <filesystem>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "raysfm/core/result.h"
#include "raysfm/geometry/trajectory.h"
#include "raysfm/results/report_file.h"
#include "raysfm/scene/reconstruction.h"

namespace raysfm {

// World from rig of every frame that has a pose, or of the key frames, in time order.
Trajectory posed_frames(const Reconstruction& reconstruction);
Trajectory posed_keyframes(const Reconstruction& reconstruction);

// Creates the folder where it is missing and makes sure that files can be written to it. Errors: bad input,
// naming the folder and the cause.
Result<void> prepare_output_folder(const std::filesystem::path& folder);

// Bad input where an input is a file that the results of `track` would replace or remove.
Result<void> check_output_folder(const std::filesystem::path& folder, std::span<const std::string> inputs);

// Whether report.json of the folder tells of a frame with a pose, or cannot be understood.
bool holds_result(const std::filesystem::path& folder);

// The files that report.json of the folder says to be its own, relative to the folder.
std::vector<std::string> files_of_result(const std::filesystem::path& folder);

// Replaces what an older run left in the folder, as a whole or not at all, by what `write` puts into the
// folder that it is given; report.json is there at the end. Other files in the folder stay.
Result<void> replace_output_folder(
    const std::filesystem::path& folder,
    const std::function<Result<void>(const std::filesystem::path& folder)>& write);

// The files of a folder that lacks nothing but its report, that one included: what the report lists.
std::vector<std::string> files_with_report(const std::filesystem::path& folder);

// Replaces what an older run left in the folder, as a whole or not at all: the main world's trajectory.txt,
// keyframes.txt, covariance.csv, points.ply and sparse/ at the top, the same of every other world in
// worlds/1, worlds/2, ..., config.yaml (`config`, as it is) and report.json. Other files in the folder stay.
//
// A reconstruction without a pose does not replace an older result: the report goes to failed.json beside it.
// The value is whether the result was written.
Result<bool> write_output_folder(const Reconstruction& reconstruction, Report report,
                                 const std::string& config, const std::filesystem::path& folder);

}  // namespace raysfm
