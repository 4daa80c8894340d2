#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "raysfm/camera/camera.h"
#include "raysfm/core/result.h"

namespace raysfm {

// The same camera in other models, by formula: every pixel keeps its ray. The model itself comes first. E.g.
// unified without distortion is eucm with alpha = xi / (1 + xi), beta = 1 and focal lengths by 1 + xi
// shorter.
std::vector<CameraModel> equivalent_models(const CameraModel& model);

// A file of a format that needs more than one, or the only one.
struct CameraFileText {
  std::string name;  // as the format calls it, e.g. "cameras.txt"
  std::string text;
};

// Names of the formats that are written: raysfm, kalibr, opencv, colmap, basalt, ocamcalib, generic.
const std::vector<std::string_view>& camera_formats();

// Models that a format can hold, by name. Of radtan, Kalibr holds no k3. Not a format: empty.
std::vector<std::string_view> models_of_format(std::string_view format);

// Whether the format holds this model with these numbers.
bool format_holds(std::string_view format, const CameraModel& model);

// A rig in another tool's format, every camera of which has a model that the format holds, or one equivalent
// to it. All but `raysfm` say where cameras stand to each other only: the first one becomes the rig. Streams,
// rois and masks stay out of them. Errors: bad input, one line with the camera and what the format holds.
Result<std::vector<CameraFileText>> format_cameras(const Rig& rig, std::string_view format);

}  // namespace raysfm
