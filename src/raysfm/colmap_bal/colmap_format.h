#pragma once

#include <span>
#include <string>
#include <string_view>

#include "raysfm/colmap_bal/colmap_model.h"
#include "raysfm/core/result.h"

namespace raysfm {

// The two formats of COLMAP's models, file by file. The readers append to the model what one file holds and
// leave what links the files (colmap_model.cpp) open. `file` names the file in messages. Errors: bad input.

// Binary.
Result<void> parse_colmap_cameras_bin(std::string_view bytes, const std::string& file, ColmapModel* model);
Result<void> parse_colmap_images_bin(std::string_view bytes, const std::string& file, ColmapModel* model);
Result<void> parse_colmap_points_bin(std::string_view bytes, const std::string& file, ColmapModel* model);
// One record of the images file, and of the points file, behind what is there.
void append_colmap_image_bin(const ColmapImage& image, std::span<const ColmapKeypoint> keypoints,
                             std::string* bytes);
void append_colmap_point_bin(const ColmapPoint& point, std::span<const ColmapTrackElement> elements,
                             std::string* bytes);
std::string format_colmap_cameras_bin(const ColmapModel& model);
std::string format_colmap_images_bin(const ColmapModel& model);
std::string format_colmap_points_bin(const ColmapModel& model);

// Text.
Result<void> parse_colmap_cameras_txt(std::string_view text, const std::string& file, ColmapModel* model);
Result<void> parse_colmap_images_txt(std::string_view text, const std::string& file, ColmapModel* model);
Result<void> parse_colmap_points_txt(std::string_view text, const std::string& file, ColmapModel* model);
std::string format_colmap_cameras_txt(const ColmapModel& model);
std::string format_colmap_images_txt(const ColmapModel& model);
std::string format_colmap_points_txt(const ColmapModel& model);

}  // namespace raysfm
