#pragma once

#include <vector>

#include "raysfm/camera_files/camera_convert.h"

namespace raysfm {

// Writers of other tools' formats, called by format_cameras() with models that they hold.
Result<std::vector<CameraFileText>> format_kalibr(const Rig& rig);
Result<std::vector<CameraFileText>> format_opencv(const Rig& rig);
Result<std::vector<CameraFileText>> format_colmap(const Rig& rig);
Result<std::vector<CameraFileText>> format_basalt(const Rig& rig);
Result<std::vector<CameraFileText>> format_ocamcalib(const Rig& rig);
Result<std::vector<CameraFileText>> format_generic(const Rig& rig);

}  // namespace raysfm
