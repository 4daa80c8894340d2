// What Odometry goes on from after a break.
#include "raysfm/odometry/odometry.h"
#include "raysfm/scene/archive_fields.h"

namespace raysfm {

template <typename A>
void archive_fields(A& a, PointMatch& x) {
  archive(a, static_cast<TrackPixel&>(x), x.in_anchor);
}

template <typename A>
void archive_fields(A& a, Localisation& x) {
  archive(a, x.ok, x.reason, x.rig_from_world, x.motion.velocity, x.motion.acceleration, x.covariance,
          x.sigma_px, x.matches, x.visible, x.anchor_points, x.visible_in_anchor, x.matched_with_anchor,
          x.blurred);
}

template <typename A>
void archive_fields(A& a, LocalPoint& x) {
  archive(a, x.track, x.keyframe, x.feature, x.in_anchor);
}

template <typename A>
void archive_fields(A& a, LocalMap& x) {
  archive(a, x.anchor, x.points);
}

template <typename A>
void Odometry::FrameRecord::archive(A& a) {
  raysfm::archive(a, timestamp, name, reason, segment, keyframe, rig_from_keyframe, covariance, place_held,
                  same_as, rank, matches);
}

template <typename A>
void Odometry::SegmentState::archive(A& a) {
  raysfm::archive(a, map, views, start, end_reason, calibration, looked_about, newest_place, newest_meeting,
                  relief_due, is_known, closed, joined_into);
}

template <typename A>
void Odometry::Previous::archive(A& a) {
  raysfm::archive(a, view, pose, velocity, interval);
}

template <typename A>
void Odometry::TurnedFrame::archive(A& a) {
  raysfm::archive(a, frame, pose);
}

template <typename A>
void Odometry::EarlyTurn::archive(A& a) {
  raysfm::archive(a, begun, turns);
}

// A view of a state, as it was when it had been processed.
ViewPtr Odometry::prepared(const ViewPtr& view) const {
  return marks_.without(view->detected() ? with_corners(view) : view);
}

// Not the views that wait, of which there are none between two pushes, nor what is scratch memory.
template <typename A>
void Odometry::archive(A& a) {
  raysfm::archive(a, marks_, evenly_from_);
  if constexpr (A::kReads) a.prepare_views([this](const ViewPtr& view) { return prepared(view); });
  raysfm::archive(a, calibration_, refiner_, segments_, active_, frames_, previous_, last_seen_, *starter_,
                  turner_, early_turn_, local_, anchor_distance_, posed_, settled_before_, places_, closures_,
                  map_covariance_, motion_watch_, shutter_found_at_, lens_found_at_);
  raysfm::archive(a, detect_timing_, start_timing_, calibrate_timing_, frame_timing_, localiser_.match_timing,
                  localiser_.pose_timing, localiser_.align_timing, mapper_.keyframe_timing,
                  mapper_.adjust_timing);
}

template void Odometry::archive(StateWriter& a);

bool Odometry::read_state(StateReader& state) {
  archive(state);
  if (!state.at_end() || !state.all_views()) return false;
  if (calibration_ > 0) rig_ = TrackingRig(refiner_.rig(), options_.error);
  return true;
}

}  // namespace raysfm
