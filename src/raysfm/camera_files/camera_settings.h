#pragma once

#include <optional>
#include <string>

#include "raysfm/camera_files/camera_import.h"

namespace raysfm {

// What the settings files of the SLAM programs share.

// "Camera: {fx: ...}" or "Camera.fx: ..." of a document: section + "." + key in either form.
ConfigField setting(const ConfigField& root, const std::string& section, const std::string& key);

// k1, k2, ... of `section` where they are there, else zero.
std::vector<double> optional_settings(const ConfigField& root, const std::string& section,
                                      std::initializer_list<const char*> keys);

// fx fy cx cy of a section.
std::vector<double> focal_settings(const ConfigField& root, const std::string& section);

// A camera as it was before the program rectified its images, from K, D and the rotation R, rectified from
// camera.
struct UnrectifiedCamera {
  ConfigField k, d, r;
  bool fisheye = false;
};

// The pair of cameras before rectification. `baseline` is the distance of the centres along the rectified x
// axis. The rig is the left camera; the size of the images is that of `image`.
Rig unrectified_pair(const UnrectifiedCamera& left, const UnrectifiedCamera& right, double baseline,
                     const Camera& image);

// Twice the same camera, the second `baseline` to the right of the first.
Rig rectified_pair(Camera left, double baseline);

}  // namespace raysfm
