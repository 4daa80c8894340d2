#pragma once

#include <filesystem>
#include <string>
#include <string_view>

#include "raysfm/camera/camera.h"
#include "raysfm/core/result.h"

namespace raysfm {

// Cameras of a file. Its content decides how it is read:
//   the project's YAML (raysfm_camera: 1), Kalibr camchain (also in OpenVINS' form), EuRoC sensor.yaml,
//   OpenCV FileStorage (perspective, fisheye, omnidir; YAML, XML, JSON; single and stereo), KITTI calib.txt,
//   COLMAP cameras.txt and rigs.txt, OCamCalib calib_results.txt, MultiCol-SLAM, the omnidirectional data
//   sets' config.yaml, basalt JSON, stella_vslam, ORB-SLAM, puzzlepaint's generic models.
// Where a format does not say the size of the images (KITTI, some of OpenCV's), width and height are 0 and
// the caller takes them from the images. Paths of masks are resolved against the folder of the file. Errors:
// bad input, one line with file, field, value and what is allowed.
// `note`, when not null, is set to what the user should know though it is no error, e.g. a camera left out.
Result<Rig> read_camera_file(const std::filesystem::path& path, std::string* note = nullptr);

// The same for text that is already in memory; `path` is used in messages, to resolve the paths of masks and
// to find the files that a rig consists of (COLMAP, MultiCol). Masks are not looked at.
Result<Rig> parse_camera_file(std::string_view text, const std::filesystem::path& path,
                              std::string* note = nullptr);

// Writes the project's YAML, beside the final name first and then renamed. Paths of masks are written as they
// are.
Result<void> write_camera_file(const Rig& rig, const std::filesystem::path& path);

// The text of that file.
std::string format_camera_file(const Rig& rig);

}  // namespace raysfm
