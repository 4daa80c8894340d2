#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "raysfm/core/result.h"
#include "raysfm/eval/consistency.h"
#include "raysfm/eval/trajectory_error.h"
#include "raysfm/geometry/trajectory.h"

namespace raysfm {

// A world of an estimate, and how it compares with the truth.
struct EvaluatedWorld {
  Trajectory estimate;
  Result<Evaluation> evaluation;
};

// Every world of an estimate, the main one first.
struct EvaluatedWorlds {
  std::vector<EvaluatedWorld> worlds;  // at least one
  double coverage = 0;                 // of the poses of the truth, those that match a pose of any world
};

// Each world alone against the truth. Errors: bad input, where the main one does not compare.
Result<EvaluatedWorlds> evaluate_worlds(std::vector<Trajectory> worlds, const Trajectory& truth,
                                        const EvaluationOptions& options);

// The same for the worlds of a file or an output folder (trajectories_of_worlds()); `truth_path` is named in
// messages.
Result<EvaluatedWorlds> evaluate_folder(const std::filesystem::path& path, const Trajectory& truth,
                                        const std::string& truth_path, const EvaluationOptions& options);

// What `eval --json` prints; `windows`, where there are any, of the main world.
std::string evaluation_json(const EvaluatedWorlds& evaluated, Alignment alignment,
                            std::span<const WindowConsistency> windows = {});

}  // namespace raysfm
