#pragma once

#include "raysfm/colmap_bal/bal_file.h"
#include "raysfm/colmap_bal/colmap_model.h"
#include "raysfm/scene/reconstruction.h"

namespace raysfm {

// A model of another tool as one world (Origin::kAdjust): every image is a key frame with a pose, numbered in
// the order of the file, which is its timestamp; a lens for each camera; points and observations in the order
// of the file and of the images. Covariances are zero, standard deviations unknown.

// The camera looks along z as everywhere here, with the pixel (0, 0) in the centre of its image, whose size
// is not known. The names of the images are empty.
Reconstruction reconstruction_of(const BalFile& file);

// Keypoints of no point are left out. A camera that has no counterpart here is no lens, and its images have
// none.
Reconstruction reconstruction_of(const ColmapModel& model);

}  // namespace raysfm
