#pragma once

#include <string>
#include <vector>

#include "raysfm/geometry/pose.h"
#include "raysfm/scene/reconstruction.h"

namespace raysfm {

// A pose as it is known at the moment.
struct FramePosed {
  int frame = 0;  // counts the frames pushed, from 0
  int world = 0;  // counts the worlds started, from 0
  Rigid3 world_from_rig;
  Matrix6d covariance = Matrix6d::Zero();  // of world_from_rig, tangent (v, w) as in docs/conventions.md
};

// Three frames began a world. The poses of frames up to the newest follow one by one.
struct WorldStarted {
  int world = 0;
  StartSummary start;
};

// What was seen does not begin a world; it goes on with later frames.
struct StartRefused {
  int frame = 0;  // the newest
  std::string reason;
};

// A frame became a key frame: the map grows by what it sees.
struct KeyFrameAdded {
  int frame = 0;
  int world = 0;
  int keyframe = 0;  // counts those that its world has, from 0
};

// Key frames were adjusted, and with them all poses of frames in [first_frame, last_frame] of the world.
// Where the scale was measured anew, poses of all its frames are now in another unit of length.
struct MapAdjusted {
  int world = 0;
  int first_frame = 0;
  int last_frame = 0;
  double rescaled = 1;  // lengths of the world now by those before
};

// What was seen tells a better calibration than the given one, and poses of the world hold with that from now
// on. Those of other worlds, and of frames long ago, follow at the end.
struct CalibrationRefined {
  int frame = 0;  // the newest
  int world = 0;
  std::vector<CalibrationNumber> numbers;  // all that are looked at
  bool contradicts = false;                // it is that of another lens
};

// Too little of the map was found in a frame.
struct TrackLost {
  int frame = 0;
  int world = 0;
  std::string reason;
};

// An old place of the world was recognised: the frame goes on in it.
struct TrackFound {
  int frame = 0;
  int world = 0;
  int keyframe = 0;  // that it was recognised in
};

// What a frame of a world saw had been seen long before: the world was bent so that both agree, or another
// world became part of it. All poses of the world may have moved.
struct PlaceSeenAgain {
  int world = 0;
  Closure closure;
  int joined_world = -1;  // that is no more, or -1
};

// Part of the images stays in its place while the rest of them moves: a text, a logo, the bonnet of a car. It
// is left out from now on.
struct MarksFound {
  int frame = 0;    // the newest
  double part = 0;  // of the images, 0 to 1
};

// Told what happens while frames are pushed, on the thread that pushes them. It must not call the tracker.
class TrackerObserver {
 public:
  virtual ~TrackerObserver() = default;
  virtual void frame_posed(const FramePosed&) {}
  virtual void world_started(const WorldStarted&) {}
  virtual void start_refused(const StartRefused&) {}
  virtual void keyframe_added(const KeyFrameAdded&) {}
  virtual void map_adjusted(const MapAdjusted&) {}
  virtual void calibration_refined(const CalibrationRefined&) {}
  virtual void track_lost(const TrackLost&) {}
  virtual void track_found(const TrackFound&) {}
  virtual void place_seen_again(const PlaceSeenAgain&) {}
  virtual void marks_found(const MarksFound&) {}
};

}  // namespace raysfm
