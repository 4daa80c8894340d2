#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "raysfm/api/config.h"
#include "raysfm/core/callbacks.h"
#include "raysfm/core/result.h"
#include "raysfm/core/timer.h"
#include "raysfm/geometry/pose.h"
#include "raysfm/scene/reconstruction.h"
#include "raysfm/uncalibrated/reconstruct.h"

namespace raysfm {

// What `raysfm solve` is told. Field names are those of the command line and of --config.
struct SolveSettings {
  std::string input;                // video, image folder or pattern, sequence folder, or CSV of point tracks
  std::string lens = "auto";        // "auto", "fixed" or "zoom"
  std::string distortion = "auto";  // "auto", "none" or "radial"
  std::string method = "polished";  // "intrinsics-free", "standard" or "polished"
  std::string constraints = "weights";  // "weights" or "lagrange"
  std::string images = "auto";          // "auto", "video" or "photos"
  std::string size;       // of the images, "WIDTHxHEIGHT", for tracks in a file; empty: guessed from them
  std::string structure;  // CSV of known positions of the points of a file of tracks; empty: none known
  double fps = 0;         // frames per second of inputs without timestamps; 0: unknown
  int features = 1000;    // corners in an image, > 0
  double max_error = 3;   // pixels, of an inlier; > 0
  int threads = 0;        // 0: as many as the machine has; never changes a result
  uint64_t seed = 0;
};

// All settings but the input. The fields point into `settings`.
std::vector<SettingField> setting_fields(SolveSettings& settings);

// What a caller hears while `solve` runs. Its progress: what is being done, e.g. "frame", how many of them
// are done, and of how many; -1: unknown.
using SolveCallbacks = Callbacks<const char*, int, int>;

// One frame of the input, with its lens.
struct SolvedFrame {
  double timestamp = 0;
  std::string image_name;
  bool keyframe = false;
  int width = 0, height = 0;                   // of the image
  std::optional<Rigid3> cam_from_world;        // empty: no pose, and `reason` says why
  Matrix6d covariance = Matrix6d::Zero();      // of world_from_cam, as docs/conventions.md has it
  Lens lens;                                   // pixels; valid where there is a pose
  LensVector lens_sigma = LensVector::Zero();  // infinite where unknown
  std::string reason;
};

struct SolvedPoint {
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  // world
  std::array<uint8_t, 3> rgb = {128, 128, 128};
};

// A point seen in a frame.
struct SolvedObservation {
  int frame = 0;
  int point = 0;
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
};

// Structure, motion and lenses; the world is the camera of the first frame with a pose, its scale arbitrary,
// unless it is given.
struct SolveResult {
  int width = 0, height = 0;  // of the images; where they differ, the largest of each
  std::vector<SolvedFrame> frames;
  std::vector<SolvedPoint> points;
  std::vector<SolvedObservation> observations;  // that agree, of key frames, ascending by frame
  bool zooming = false;
  std::string lens_evidence;
  std::string degenerate;                 // empty or its name
  RadialDistortion radial, radial_sigma;  // of all images; none unless it was estimated
  bool world_is_given = false;            // the world and the scale are those of the known structure
  double rms_px = 0;                      // over `observations`
  int start_frames[2] = {-1, -1};
  int start_inliers = 0;
  LensAdjustmentSummary adjustment;
  std::vector<std::pair<std::string, StageTiming>> stages;  // in the order of the work
  double read_s = 0, solve_s = 0, wall_s = 0, peak_rss_mib = 0;
  bool interrupted = false;
};

// Unknown or zooming lens (IFBA01). Errors: bad input; no reconstruction with the reason.
Result<SolveResult> solve(const SolveSettings& settings, const SolveCallbacks& callbacks);

// Whether writing the results into `folder` would leave the input alone; else bad input.
Result<void> check_solve_output(const std::filesystem::path& input, const std::filesystem::path& folder);

// Replaces what an older run left in the folder, as a whole or not at all, by trajectory.txt, keyframes.txt,
// covariance.csv, points.ply, lens.csv, lens.png, sparse/, config.yaml and report.json.
Result<void> write_solve_output(const SolveResult& result, const SolveSettings& settings,
                                const std::string& version, const std::filesystem::path& folder);

}  // namespace raysfm
