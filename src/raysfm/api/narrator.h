#pragma once

#include <string>
#include <vector>

#include "raysfm/core/callbacks.h"
#include "raysfm/odometry/observer.h"
#include "raysfm/odometry/tracker.h"
#include "raysfm/results/report_file.h"
#include "raysfm/scene/reconstruction.h"

namespace raysfm {

// Puts into words what the user is told as it happens. While nothing starts, why not is told now and then.
class Narrator : public TrackerObserver {
 public:
  Narrator(const EventSink& event, const LensOrigin& origin) : event_(event), origin_(origin) {}

  void world_started(const WorldStarted& e) override;
  void start_refused(const StartRefused& e) override;
  void calibration_refined(const CalibrationRefined& e) override;
  void track_lost(const TrackLost& e) override;
  void track_found(const TrackFound& e) override;
  void place_seen_again(const PlaceSeenAgain& e) override;
  void marks_found(const MarksFound& e) override;

 private:
  const EventSink& event_;
  const LensOrigin& origin_;
  int next_refusal_ = 0;  // frame from which one is told
};

// Tells two observers; the second may be null.
class ObserverPair : public TrackerObserver {
 public:
  ObserverPair(TrackerObserver* first, TrackerObserver* second) : first_(first), second_(second) {}

  void frame_posed(const FramePosed& e) override { tell(&TrackerObserver::frame_posed, e); }
  void world_started(const WorldStarted& e) override { tell(&TrackerObserver::world_started, e); }
  void start_refused(const StartRefused& e) override { tell(&TrackerObserver::start_refused, e); }
  void keyframe_added(const KeyFrameAdded& e) override { tell(&TrackerObserver::keyframe_added, e); }
  void map_adjusted(const MapAdjusted& e) override { tell(&TrackerObserver::map_adjusted, e); }
  void calibration_refined(const CalibrationRefined& e) override {
    tell(&TrackerObserver::calibration_refined, e);
  }
  void track_lost(const TrackLost& e) override { tell(&TrackerObserver::track_lost, e); }
  void track_found(const TrackFound& e) override { tell(&TrackerObserver::track_found, e); }
  void place_seen_again(const PlaceSeenAgain& e) override { tell(&TrackerObserver::place_seen_again, e); }
  void marks_found(const MarksFound& e) override { tell(&TrackerObserver::marks_found, e); }

 private:
  template <typename What>
  void tell(void (TrackerObserver::*hear)(const What&), const What& e) {
    (first_->*hear)(e);
    if (second_) (second_->*hear)(e);
  }

  TrackerObserver* first_;
  TrackerObserver* second_;
};

// What there is to say of a run when it has ended; each is empty where there is nothing.

// Of a lens that changes.
std::string zoom_warning(const SeenZoom& change);
// Of the stretch where most does not stand still.
std::string motion_warning(const std::vector<OtherMotion>& seen);
// Of a rolling shutter that was found, and given up.
std::string dropped_shutter_warning(bool is_dropped);
// Of a main world that is the three views of its start: a map that is wrong seldom grows, and of one that did
// not nothing says that it is right.
std::string start_warning(const Reconstruction& reconstruction);
// Of the weakest place of the maps.
std::string link_warning(const Reconstruction& reconstruction);

}  // namespace raysfm
