#pragma once

#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "raysfm/core/result.h"
#include "raysfm/image/pixels.h"
#include "raysfm/image/repeat_watch.h"
#include "raysfm/mapping/options.h"
#include "raysfm/odometry/observer.h"
#include "raysfm/odometry/odometry.h"
#include "raysfm/scene/reconstruction.h"
#include "raysfm/views/view_maker.h"

namespace raysfm {

// What a tracker is told beside its rig.
struct TrackerOptions {
  OdometryOptions odometry;
  // Of each camera, or none at all: 255 where a pixel sees the scene, in the size of the camera's image; an
  // empty one says that all do. What the camera's model knows to be blind is left out anyway.
  std::vector<GrayImage> masks;
  // Of earlier runs with the same cameras: they are recognised, and tracked on in. What `frame` of their key
  // frames says does not matter.
  std::vector<Map> known_worlds = {};
};

// Poses of a calibrated rig, frame by frame (LBA09 2.7). Whoever has a camera pushes its images and has the
// pose when push() returns. One thread calls; the work is done in these calls and nowhere else.
//
// Poses of frames from first_movable_frame() on may still move, as later frames improve the map; a rig whose
// scale has to be measured may change the unit of length of a world as well, and a calibration that is
// refined all poses of it: the observer hears of both.
class Tracker {
 public:
  // The sizes of the cameras are known. `observer` may be null, and outlives the tracker. Errors: bad input,
  // where an option is out of range, a mask has another size than its camera, or the error measure needs a
  // camera that can project.
  static Result<std::unique_ptr<Tracker>> create(const Rig& rig, TrackerOptions options,
                                                 TrackerObserver* observer = nullptr);
  Tracker(const Tracker&) = delete;
  Tracker& operator=(const Tracker&) = delete;

  // Images taken at one instant, element s for the cameras of stream s; they are copied. An empty one is an
  // image that did not arrive: the frame has no pose then. `timestamp` in seconds, above that of the frame
  // before. `name` is kept with the frame; empty: "frame-000012". Errors: bad input, and the frame does not
  // count.
  Result<FrameResult> push(std::span<const PixelView> images, double timestamp, std::string name = {});

  // A view that maker() made, perhaps ahead of time on another thread; view->frame is frames(). Errors: those
  // of create() that only images tell: poses of cameras that were given in the opposite direction.
  Result<FrameResult> push(ViewPtr view);

  // Turns pictures into views; any thread may use it.
  const ViewMaker& maker() const { return maker_; }

  int frames() const { return odometry_.frames(); }
  int posed() const { return odometry_.posed(); }
  // Frames before it keep their poses, but for finish() with a final adjustment and for a refined
  // calibration.
  int first_movable_frame() const { return odometry_.first_movable_frame(); }

  // What is known now; changes nothing. Time and memory are those of a copy of the map.
  Reconstruction snapshot() const { return odometry_.snapshot(); }
  // No more frames will come: the last call. Adjusts everything when told so. Every frame has a pose or a
  // reason.
  // `maps`, where it is not null, becomes the map of each world that can be known to a later run, key frames
  // of this run with the `frame` that they were taken from; those of earlier ones have -n to -1, in the order
  // of known_worlds and its key frames, of which there were n.
  Reconstruction finish(bool final_adjustment, std::vector<Map>* maps = nullptr) {
    return odometry_.finish(final_adjustment, maps);
  }

  // What it takes to go on later from where it is, in a tracker of the same rig and options, with the same
  // results to the last bit. Reading: false, and the tracker is not to be used, where the bytes are not such
  // a state.
  void write_state(StateWriter& state);
  bool read_state(StateReader& state);

  OdometryTimings timings() const { return odometry_.timings(); }

  // Whether the focal length is another one from some frame on, beyond doubt: one calibration does not hold
  // all, and `solve` does better. None where nothing is refined. Before finish().
  std::optional<SeenZoom> lens_change() { return odometry_.lens_change(); }
  // The newest frame when a rolling shutter was found that nobody told; -1: none was.
  int shutter_found_at() const { return odometry_.shutter_found_at(); }
  // The newest frame when the lenses changed by more than a map of many key frames can follow; -1: they never
  // did.
  int lens_found_at() const { return odometry_.lens_found_at(); }
  // Whether one was found that is none: rows are exposed in one order in a part of the footage and in the
  // other in another.
  bool dropped_shutter() const { return odometry_.dropped_shutter(); }
  std::vector<OtherMotion> other_motion() const { return odometry_.other_motion(); }
  NewestView newest_view() const { return odometry_.newest_view(); }
  // Images of the newest key frames of the world that was tracked last, at most so many, oldest first:
  // without corners, and as far as they are kept. Before finish().
  std::vector<ViewPtr> newest_keyframes(int most) const { return odometry_.newest_keyframes(most); }
  // Every number of the calibration that is looked at, as the frames so far tell it.
  std::vector<CalibrationNumber> calibration() const { return odometry_.calibration(); }
  const TrackingRig& rig() const { return odometry_.rig(); }

 private:
  Tracker(const Rig& rig, std::vector<GrayImage> masks, const OdometryOptions& options,
          TrackerObserver* observer);
  Result<void> check(std::span<const PixelView> images, double timestamp) const;

  std::vector<GrayImage> masks_;
  ViewMaker maker_;
  Odometry odometry_;
  int streams_ = 1;
  std::optional<double> newest_;  // timestamp
  bool checked_ = false;          // the directions of the extrinsics
  RepeatWatch repeats_;           // of images, not of views
};

}  // namespace raysfm
