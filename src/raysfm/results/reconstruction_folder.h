#pragma once

#include <filesystem>

#include "raysfm/core/result.h"
#include "raysfm/scene/reconstruction.h"

namespace raysfm {

// What write_output_folder() wrote, every world a segment again. Timestamps, poses, covariances and the
// points that key frames see come back bit by bit; other points as floats, pixels but for the rounding of
// half a pixel. The name of an image comes back for key frames and for frames without a pose. Cameras and
// observations come from sparse/, and there are none where COLMAP has no such camera.
//
// Errors: bad input, naming the file.
Result<Reconstruction> read_reconstruction(const std::filesystem::path& folder);

}  // namespace raysfm
