// What Odometry does when track is lost, until it goes on.
#include <optional>
#include <string>
#include <utility>

#include "raysfm/odometry/odometry.h"
#include "raysfm/views/blindness.h"

namespace raysfm {

void Odometry::lose(ViewPtr view, const std::string& reason) {
  view = detected(view);
  segment().end_reason = reason;
  const std::optional<std::string> blind = blindness(*view);
  frames_[view->frame].reason = blind ? *blind : "track lost: " + reason;
  observer_->track_lost({view->frame, world(), blind ? *blind : reason});
  remember_end();
  add_end();
  last_seen_ = std::exchange(previous_, std::nullopt);
  starter_.emplace(rig_, options_);
  if (options_.departures.turning) begin_turn();
  turn_on_the_spot(view);
  if (options_.starts_worlds) start(view);
}

// From the view that was posed last. A part of what was near before must not pass for a turn.
void Odometry::begin_turn() {
  last_seen_->view = detected(last_seen_->view);
  const FrameRecord& frame = frames_[last_seen_->view->frame];
  turner_.begin(last_seen_->view, {present_pose(frame, segment().map), frame.covariance}, anchor_distance_,
                {});
}

// The view goes on from the last one as if it had only turned since, which hangs on the same key frame.
bool Odometry::turn_on_the_spot(const ViewPtr& view) {
  if (segments_.empty()) return false;
  const std::optional<TurnedPose> turned = turner_.advance(view, options_.seed);
  if (!turned) return false;
  record_turned(view->frame, *turned, frames_[last_seen_->view->frame].keyframe);
  Localisation pose;
  pose.rig_from_world = turned->rig_from_world;
  pose.covariance = turned->covariance;
  last_seen_ = following(*last_seen_, view, std::move(pose));
  return true;
}

bool Odometry::relocalise(const ViewPtr& view) {
  localiser_.set_motion(RigMotion{});
  if (find_again(view)) return true;
  const Map& map = segment().map;
  const int newest = static_cast<int>(map.keyframes.size()) - 1;
  if (segment().views[newest].view) {
    const LocalMap local = make_local_map(map, segment().views, rig_, newest, 0);
    const Localisation pose =
        localiser_.localise(map, segment().views, local, *view, map.keyframes[newest].rig_from_world,
                            range_of(Effort::kBlind, *view));
    if (convincing(pose) && take_up(view, newest, pose.rig_from_world, false)) return true;
  }
  if (recall(view)) return true;
  frames_[view->frame].reason = (posed_ > 0 ? "track lost: " : "") + segment().end_reason;
  return false;
}

// The view as if track had gone on from the last posed one: that it was lost may have been a matter of blur.
bool Odometry::find_again(const ViewPtr& view) {
  if (!last_seen_) return false;
  const FrameRecord& frame = frames_[last_seen_->view->frame];
  if (frame.segment != active_) return false;
  last_seen_->pose.rig_from_world = present_pose(frame, segment().map);
  const int anchor = keyframe_in_sight(segment().map, segment().views, rig_, last_seen_->pose.rig_from_world);
  if (anchor < 0) return false;
  const LocalMap local = make_local_map(segment().map, segment().views, rig_, anchor, kLocalReach);
  const Rigid3 turned_on = turned(*last_seen_->view, *view) * last_seen_->pose.rig_from_world;
  for (const Rigid3& predicted : {turned_on, moved_on(*last_seen_, *view)}) {
    Localisation pose = localiser_.follow(segment().map, segment().views, local, *view, predicted,
                                          options_.departures.blur ? Focus::kBlurred : Focus::kSharp);
    if (!anchor_is_in_sight(pose) || !recognised(pose, options_)) continue;
    resume(view, anchor, std::move(pose));
    return true;
  }
  return false;
}

// Track again from a key frame and a first pose of the view; false, where the view does not see what it
// should. Less will do where corners found without that pose agree on it.
bool Odometry::take_up(const ViewPtr& view, int keyframe, const Rigid3& rig_from_world, bool corners_agree) {
  const Map& map = segment().map;
  const LocalMap local = make_local_map(map, segment().views, rig_, keyframe, kLocalReach);
  Localisation pose =
      localiser_.localise(map, segment().views, local, *view, rig_from_world, range_of(Effort::kNear, *view));
  if (!recognised(pose, options_) && !(corners_agree && believable(pose))) return false;
  resume(view, keyframe, std::move(pose));
  return true;
}

// Track goes on from a key frame of the active world.
void Odometry::resume(const ViewPtr& view, int keyframe, Localisation pose) {
  observer_->track_found({view->frame, world(), keyframe});
  last_seen_.reset();
  turner_.end();
  const std::vector<WaitingView> missed = starter_->views();
  starter_.emplace(rig_, options_);
  segment().end_reason = "end of input";
  set_anchor(keyframe);
  accept(view, std::move(pose));
  pose_missed(missed);
}

// Views since track was lost, back in time from the one that was found again: what kept track from going on
// may not keep it from coming back.
void Odometry::pose_missed(const std::vector<WaitingView>& missed) {
  const Previous found = *previous_;
  for (auto waiting = missed.rbegin(); waiting != missed.rend(); ++waiting) {
    ViewPtr view = waiting->view ? waiting->view : waiting->coarse;
    if (!view) continue;
    Localisation pose = waiting->view ? localise(&view) : follow(*view);
    if (!followed(pose, options_)) break;
    follow_scan(*view, &pose);
    record(view->frame, pose, local_.anchor);
    previous_ = following(*previous_, view, std::move(pose));
  }
  previous_ = found;
  pose_copies(missed);
  learn_velocity();
}

}  // namespace raysfm
