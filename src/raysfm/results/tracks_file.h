#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <string>
#include <vector>

#include "raysfm/core/result.h"

namespace raysfm {

// Point tracks as a file has them. Observation k: point[k] is seen in image[k] at pixel[k]; no (image, point)
// twice.
struct TracksFile {
  std::vector<std::string> images;     // names, in the order of their numbers, or of names if one has none
  std::vector<double> timestamps;      // strictly increasing: the numbers, or the index in `images`
  std::vector<std::string> points;     // names, in the order of the file
  std::vector<int> image;              // index into `images`
  std::vector<int> point;              // index into `points`
  std::vector<Eigen::Vector2d> pixel;  // centre of the first pixel at (0, 0)
};

// Points of known positions, such as the corners of a board.
struct StructureFile {
  std::vector<std::string> points;         // names, no one twice
  std::vector<Eigen::Vector3d> positions;  // one for each, in a unit of the file's own
};

// Whether the name ends in .csv or the content begins like such a file.
bool is_tracks_file(const std::filesystem::path& path);

// Reads `image,point,u,v` behind a header line of just these names. Images and points are numbers or names.
// Empty lines and lines that begin with # are passed over. Errors: bad input, naming file, line, field, value
// and what is allowed.
Result<TracksFile> read_tracks_file(const std::filesystem::path& path);

// Reads `point,x,y,z` behind a header line of just these names; otherwise as read_tracks_file().
Result<StructureFile> read_structure_file(const std::filesystem::path& path);

}  // namespace raysfm
