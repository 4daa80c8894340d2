#pragma once

#include <filesystem>

#include "raysfm/core/result.h"
#include "raysfm/scene/reconstruction.h"

namespace raysfm {

// Writes cameras.bin, images.bin and points3D.bin, a sparse model that COLMAP 3.8 opens, into `folder`, which
// is created where it is missing. Each camera of each key frame is one image. colmap_camera() says what each
// camera model becomes; where a camera has no counterpart in COLMAP, nothing is written. The origin of pixels
// moves to the corner of the image (+0.5).
//
// Segments do not share a world, so that the model holds the first segment with most key frames only. The
// names of images are those of PosedFrame::image_name, behind "<camera>/" where the rig has several cameras.
Result<void> write_colmap_model(const Reconstruction& reconstruction, const std::filesystem::path& folder);

}  // namespace raysfm
