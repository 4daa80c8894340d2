#pragma once

#include <filesystem>
#include <functional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "raysfm/core/result.h"

namespace raysfm {

// What `raysfm export` is told.
struct ExportSettings {
  std::filesystem::path result;  // an output folder of `track`, `solve` or `adjust`
  std::string format;            // one of export_formats()
  std::filesystem::path out;     // folder; empty: RESULT-FORMAT beside the result
  int world = 0;                 // as in report.json, 0 is the main one
  bool all_frames = false;       // images of every frame with a pose, not of key frames alone; needs `images`
  bool text = false;             // COLMAP's text instead of binary files
  bool undistort = false;        // cameras become pinholes
  std::vector<std::string> images;  // where the frames are; empty: no image is written
  std::string camera;               // camera file; empty: what the result tells
  int texture_side = 4096;          // most texels along a side of a mesh's texture; 64 to 16384
  int threads = 0;                  // 0: as many as the machine has
};

// What was written.
struct ExportSummary {
  std::filesystem::path out;
  int frames = 0;                  // with a pose
  int images = 0, points = 0;      // of formats that have them
  int faces = 0;                   // of a mesh
  std::vector<std::string> notes;  // what the user should know, a line each
};

// How far a long export is: what is done, how much of it, and how much there is.
using ExportProgress = std::function<void(const char* stage, int done, int total)>;

// "colmap", "nerfstudio", "blender", "bundler", "ply", "tum", "kitti", "euroc" and "mesh".
std::span<const std::string_view> export_formats();

// Writes a world of a result in another tool's format, into a folder that is replaced as a whole or not at
// all; export.json there lists the files. Errors: bad input, one line: no result, no such world, a camera
// that the format cannot hold and which formats can, images that do not fit; no reconstruction, where a map
// tells no surface.
Result<ExportSummary> export_result(const ExportSettings& settings, const ExportProgress& progress = {});

}  // namespace raysfm
