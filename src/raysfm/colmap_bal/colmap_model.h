#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <string>
#include <vector>

#include "raysfm/camera_files/colmap_camera.h"
#include "raysfm/core/result.h"
#include "raysfm/geometry/pose.h"

namespace raysfm {

// Of keypoints that no point was made of.
constexpr uint64_t kNoColmapPoint = std::numeric_limits<uint64_t>::max();

// Pixels are counted from the corner of the first one.
struct ColmapKeypoint {
  double x = 0, y = 0;
  uint64_t point_id = kNoColmapPoint;
};

// An image with its pose, camera from world, as the file has it (the quaternion w first and not normalised),
// and the range [first_keypoint, last_keypoint) of ColmapModel::keypoints.
struct ColmapImage {
  uint32_t id = 0;
  std::array<double, 4> rotation = {1, 0, 0, 0};
  std::array<double, 3> translation = {};
  uint32_t camera_id = 0;
  std::string name;
  size_t first_keypoint = 0, last_keypoint = 0;
  int camera = 0;  // index into ColmapModel::cameras
};

// Camera from world, with a unit quaternion.
inline Rigid3 colmap_pose(const ColmapImage& image) {
  const auto& [w, x, y, z] = image.rotation;
  const auto& t = image.translation;
  return {Eigen::Quaterniond(w, x, y, z).normalized(), {t[0], t[1], t[2]}};
}

// Keypoint `keypoint` of an image.
struct ColmapTrackElement {
  uint32_t image_id = 0;
  uint32_t keypoint = 0;
  int image = 0;  // index into ColmapModel::images
};

// A point with the range [first_element, last_element) of ColmapModel::elements. The error is the mean
// distance in pixels between its keypoints and its projections, -1 where it is not known.
struct ColmapPoint {
  uint64_t id = 0;
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  // world
  std::array<uint8_t, 3> rgb = {};
  double error = -1;
  size_t first_element = 0, last_element = 0;
};

// A sparse model of COLMAP: what its cameras, images and points3D files hold, in their order. In a model that
// was read, identifiers are unique, all references lead somewhere, and keypoints and tracks agree.
struct ColmapModel {
  bool binary = true;  // .bin files, else .txt
  std::vector<ColmapCamera> cameras;
  std::vector<ColmapImage> images;
  std::vector<ColmapKeypoint> keypoints;
  std::vector<ColmapPoint> points;
  std::vector<ColmapTrackElement> elements;
};

// The contents of the three files.
struct ColmapFiles {
  bool binary = true;
  std::string cameras, images, points;
};

// Errors: bad input, naming the file below `folder`, the line or the record, the value and what is allowed.
Result<ColmapModel> parse_colmap(const ColmapFiles& files, const std::string& folder);

// Binary files come back as they were read, byte by byte; text with 17 digits.
ColmapFiles format_colmap(const ColmapModel& model);

// Whether the folder holds one of the files of a model.
bool is_colmap_model(const std::filesystem::path& folder);

// The model in a folder, binary where there are both kinds, as COLMAP chooses.
Result<ColmapModel> read_colmap_model(const std::filesystem::path& folder);

// Writes the three files into `folder`, which is created where it is missing.
Result<void> write_colmap_model(const ColmapModel& model, const std::filesystem::path& folder);

}  // namespace raysfm
