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

// Bad input where an input is a file that the results would replace or remove; `more`: names of files beside
// those of every world.
Result<void> check_output_folder(const std::filesystem::path& folder, std::span<const std::string> inputs,
                                 std::span<const std::string> more = {});

// A file or folder that results have beside those of every world.
struct ResultFile {
  std::string name;  // in the output folder
  std::function<Result<void>(const std::filesystem::path& path)> write;
};

// Writes a page that shows a result.
using PageWriter = std::function<Result<void>(const Reconstruction& reconstruction, const Report& report,
                                              const std::filesystem::path& path)>;

// From now on results have report.html, which this writes; empty, as at first: they have none. Not while
// results are being written.
void set_page_writer(PageWriter writer);

// Replaces what an older run left in the folder, as a whole or not at all: the files of the main world
// (world_writers()) at the top, the same of every other world in worlds/1, worlds/2, ..., those of `more`,
// config.yaml (`config`, as it is) and report.json, which lists them all. Other files in the folder stay.
//
// A reconstruction without a pose does not replace an older result: the report goes to failed.json beside it.
// The value is whether the result was written.
Result<bool> write_output_folder(const Reconstruction& reconstruction, Report report,
                                 const std::string& config, const std::filesystem::path& folder,
                                 std::span<const ResultFile> more = {});

}  // namespace raysfm
