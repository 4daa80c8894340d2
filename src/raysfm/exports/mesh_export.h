#pragma once

#include <filesystem>

#include "raysfm/core/result.h"
#include "raysfm/exports/export_scene.h"
#include "raysfm/scene/reconstruction.h"

namespace raysfm {

// The surface of a world by its map.
Result<void> write_mesh(const Reconstruction& world, const ExportScene& scene,
                        const std::filesystem::path& folder);

}  // namespace raysfm
