#pragma once

#include <filesystem>

#include "raysfm/frames/frame_source.h"

namespace raysfm {

// Opens a folder whose layout is recognised in this order:
// - euroc: mav0/cam0/data.csv (or cam0/data.csv); frames that all cameras have, paired by their nanoseconds
// - tum-rgbd: rgb.txt
// - kitti: image_0 and image_1, else image_2 and image_3; times.txt, calib.txt
// - sequence: images/, or cam0/, cam1/, ...; times.txt
// - images: image files
// camera.yaml in the folder is the calibration if it exists, else what the layout has.
// Errors: bad input, naming file, line, value and what is allowed.
Result<Input> open_folder(const std::filesystem::path& folder, const InputOptions& options);

}  // namespace raysfm
