#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "raysfm/camera/camera.h"
#include "raysfm/core/result.h"

namespace raysfm {

// A camera model of COLMAP: its number in binary files, its name in text files and how many numbers it has.
struct ColmapCameraModel {
  int32_t id;
  std::string_view name;
  size_t parameters;
};

// Null where there is no such model. COLMAP 3.8 knows 0 to 10, later ones up to 17.
const ColmapCameraModel* find_colmap_model(int32_t id);
const ColmapCameraModel* find_colmap_model(std::string_view name);

// All names, for messages.
std::string colmap_model_names();

// COLMAP counts pixels from the corner of the first one, this project from its centre: what to add on the way
// out.
inline constexpr double kColmapPixelOrigin = 0.5;

// A camera as COLMAP has it. Pixels are counted from the corner of the first one.
struct ColmapCamera {
  uint32_t id = 0;
  int32_t model = 0;  // always one that find_colmap_model() finds
  uint64_t width = 0, height = 0;
  std::vector<double> parameters;
};

// The same camera among the models of this project, pixels counted from the centre of the first one. Errors:
// bad input, without the file's name, where the project has no model that is exactly this one, or numbers
// that no camera has.
Result<CameraModel> camera_model_from_colmap(int32_t model, std::span<const double> parameters);

// Model and parameters of COLMAP for the same camera; nullopt where COLMAP has none. Pinhole becomes PINHOLE,
// radtan OPENCV or, where k3 is not zero, FULL_OPENCV, rational FULL_OPENCV, kannala-brandt OPENCV_FISHEYE,
// eucm EUCM (which COLMAP 3.8 does not know). Of the others the width and
// height, which are not part of a CameraModel, stay for the caller to fill.
std::optional<ColmapCamera> colmap_camera(const CameraModel& model);

}  // namespace raysfm
