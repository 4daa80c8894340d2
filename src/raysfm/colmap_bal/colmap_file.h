#pragma once

#include <filesystem>

#include "raysfm/core/result.h"
#include "raysfm/scene/reconstruction.h"

namespace raysfm {

// Writes cameras.bin, images.bin and points3D.bin, a sparse model that COLMAP 3.8 opens, into `folder`, which
// is created where it is missing. Each camera of each key frame is one image; lenses of the same numbers are
// one camera. colmap_camera() says what each camera model becomes, and an estimated lens with distortion
// becomes RADIAL; where a camera has no counterpart in COLMAP, nothing is written. The origin of pixels moves
// to the corner of the image (+0.5). Points have their mean error, those of estimated lenses none.
//
// The names of images are those of PosedFrame::image_name, behind "<camera>/" where the rig has several
// cameras.
Result<void> write_colmap_model(const Reconstruction& world, const std::filesystem::path& folder);

}  // namespace raysfm
