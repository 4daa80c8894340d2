#pragma once

#include <filesystem>

#include "raysfm/core/result.h"
#include "raysfm/exports/scene_images.h"
#include "raysfm/exports/undistort.h"
#include "raysfm/scene/reconstruction.h"

namespace raysfm {

// Reads every frame of `input` that the scene has images of and writes these as PNG into `folder`, under
// their names. `pinholes`, when not null, is what undistort() made of the scene: then its images are written
// instead, each pixel interpolated between four of its source, black where that sees nothing. Errors: bad
// input, where frames are missing, damaged, of another size or of other names.
Result<void> write_images(const ImageInput& input, const Reconstruction& world, const ExportScene& scene,
                          const UndistortedScene* pinholes, const std::filesystem::path& folder);

}  // namespace raysfm
