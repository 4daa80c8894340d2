#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "raysfm/camera/camera.h"
#include "raysfm/core/time_range.h"
#include "raysfm/geometry/pose.h"
#include "raysfm/scene/frame_lens.h"

namespace raysfm {

// One frame of the input. `world_from_rig` is empty where the frame could not be posed; `reason` then says
// why.
struct PosedFrame {
  double timestamp = 0;  // seconds
  int segment = -1;      // index into Reconstruction::segments, -1 without a pose
  std::optional<Rigid3> world_from_rig;
  Matrix6d covariance = Matrix6d::Zero();  // of world_from_rig, tangent (v, w) as in docs/conventions.md
  std::string reason;
  bool place_held =
      false;  // only its turning was seen: it is where the frames before it were, as far as known
  std::string image_name;  // name of the image file or "frame_000012"
  int lens = -1;           // index into Reconstruction::lenses, -1: the rig's, or unknown
};

// A key frame's observations are the range [first_observation, last_observation) of
// Reconstruction::observations.
struct KeyFrame {
  int frame = 0;  // index into Reconstruction::frames
  int first_observation = 0;
  int last_observation = 0;
};

struct Observation {
  int point = 0;   // index into Reconstruction::points
  int camera = 0;  // index into Rig::cameras
  // Where the point would be at the instant of the frame: what a rolling shutter moved it by is undone.
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
};

struct MapPoint {
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  // world frame of its segment
  std::array<uint8_t, 3> rgb = {128, 128, 128};
  int segment = 0;
};

// A stretch of the input with one world frame and one scale. Segments do not share a world.
struct Segment {
  int first = 0;  // frame indices, inclusive
  int last = 0;
  std::string reason;  // why it ended: "end of input", or why track was lost
  bool metric_scale = false;
  std::optional<double>
      scale_sigma;  // standard deviation of the logarithm of the scale, where something tells it
};

// How a segment began (LBA09 2.2).
struct StartSummary {
  std::string method;       // e.g. "five-point"
  std::vector<int> frames;  // frame indices of the views used
  int inliers = 0;          // points that survived; 0 where the rig was only seen to turn
};

// A place that was seen again long after, or in another world, and what that brought together.
struct Closure {
  int frame = 0;               // index of the input frame that saw it again
  int with_frame = 0;          // that of the earlier one; -1: of an earlier run
  int inliers = 0;             // points that both see
  bool joined_worlds = false;  // two worlds became one; else a loop was closed
  // How far the later frame moved for it, as a part of the distance to its points; 0 where worlds were
  // joined.
  double correction = 0;
};

// A number of the calibration, as it was given and as the footage has it.
struct CalibrationNumber {
  int camera = 0;    // index into Rig::cameras
  std::string name;  // as in the camera file; `rotation` in radians about the axes of the camera as given
  double given = 0;
  double refined = 0;  // the given one where it stays
  double sigma = 0;    // of `refined`, standard deviation; what calibrations are off where it is not told
  double significance = 0;  // of what was found off it, in standard deviations
  bool told = false;        // whether the footage tells it better than that
};

// The command that made a reconstruction. It decides which files the results have (results/world_writers.h).
enum class Origin : uint8_t {
  kTrack,   // of calibrated cameras: the rig
  kSolve,   // lenses were unknown: frames with a pose have their lens, there is no rig
  kAdjust,  // a model of another tool: the same, and its images are numbered instead of timed
};

// What a video, photos, tracks or a model of another tool became: poses of frames, and the map.
struct Reconstruction {
  Origin origin = Origin::kTrack;
  Rig rig;                                     // refined where `calibration` says so
  std::vector<CalibrationNumber> calibration;  // empty: as given, nothing was refined
  std::vector<FrameLens> lenses;               // where they are not the rig's; a fixed lens is one entry
  bool metric_scale = false;                   // of the segment with most posed frames
  std::optional<double> scale_sigma = std::nullopt;  // likewise
  TimeRange range;                                   // the part of the input that was asked for
  std::vector<PosedFrame> frames;                    // one per frame of that part, in time order
  std::vector<KeyFrame> keyframes;
  std::vector<Observation> observations;
  std::vector<MapPoint> points;
  std::vector<Segment> segments;
  std::vector<StartSummary> starts;  // one per segment
  std::vector<Closure> closures;     // in the order of their frames
  double rms_reprojection_px = 0;    // over `observations`
};

// Camera `camera` of the rig in this frame: its own lens where it has one. There must be one of the two.
inline const Camera& camera_of(const Reconstruction& reconstruction, const PosedFrame& frame, int camera) {
  return frame.lens >= 0 ? reconstruction.lenses[frame.lens].camera : reconstruction.rig.cameras[camera];
}

}  // namespace raysfm
