#pragma once

#include <filesystem>
#include <span>

#include "raysfm/core/result.h"
#include "raysfm/scene/reconstruction.h"

namespace raysfm {

// A file, or a folder of files, of a world: what it is called, whose results have it and how one world is
// written to that path.
struct WorldWriter {
  const char* name;
  std::span<const Origin> origins;
  Result<void> (*write)(const Reconstruction& world, const std::filesystem::path& path);
};

// trajectory.txt, keyframes.txt, covariance.csv, points.ply, lens.csv, sparse/ and observations.csv.
std::span<const WorldWriter> world_writers();

// Where the files of a world are, below the output folder: the main world (0) has them at the top, the others
// in worlds/1, worlds/2, ...
std::filesystem::path world_folder(int world);

// Writes every file that such a world has into `folder`, which is created where it is missing.
Result<void> write_world(const Reconstruction& world, const std::filesystem::path& folder);

}  // namespace raysfm
