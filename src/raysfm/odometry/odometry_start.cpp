// What Odometry does when a world starts: its first frames.
#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "raysfm/geometry/interpolation.h"
#include "raysfm/odometry/odometry.h"

namespace raysfm {

void Odometry::start(const ViewPtr& view) {
  ScopedTimer timer(start_timing_);
  const int attempts = starter_->attempts();
  std::optional<Start> start = starter_->push(view, mapper_);
  if (starter_->attempts() > attempts && !start) {
    observer_->start_refused({view->frame, starter_->last_reason()});
  }
  if (!start) return;
  const std::vector<WaitingView> views = starter_->views();
  starter_.emplace(rig_, options_);
  begin_segment(std::move(*start), views);
}

void Odometry::begin_segment(Start start, const std::vector<WaitingView>& views) {
  const std::vector<int> chosen = start.summary.frames;
  if (!segments_.empty()) {
    segment().views = std::vector<KeyFrameView>();  // what was seen of it is remembered without images
    settle_until(views.front().frame);
  }
  segments_.push_back({std::move(start.map), std::move(start.views), start.summary});
  active_ = static_cast<int>(segments_.size()) - 1;
  last_seen_.reset();
  turner_.end();
  segment().calibration = calibration_;
  motion_watch_.restart();
  observer_->world_started({world(), start.summary});
  map_covariance_.follow(rig_, segment().map, world());
  pose_start_frames(start, views);
  pose_earlier_frames(views, start.first_view);
  pose_copies(views);
  if (rig_.scans()) refine_start();

  const auto third = std::ranges::find(views, chosen[2], &WaitingView::frame);
  previous_ = Previous{third->view, seen_by_keyframe(segment().map.keyframes[2], segment().map), {}, 0};
  learn_velocity();
  if (rig_.scans()) previous_->pose.velocity = present_velocity(chosen[2]);
  set_anchor(2);
  for (auto it = views.end(); it != third + 1;) waiting_.push_front((--it)->view);
}

// Poses a frame of the start against the key frame nearest in time, and records it. Without corners where it
// has none any more.
bool Odometry::pose_near(const View& view, const LocalMap& local, const Rigid3& predicted, bool sure,
                         Rigid3* rig_from_world) {
  const Map& map = segment().map;
  const Localisation pose = view.detected()
                                ? localiser_.localise(map, segment().views, local, view, predicted,
                                                      range_of(sure ? Effort::kNear : Effort::kWide, view))
                                : localiser_.follow(map, segment().views, local, view, predicted);
  if (!believable(pose)) {
    std::string& reason = frames_[view.frame].reason;
    if (reason.empty())
      reason = fmt::format("not matched with the start at frame {}", map.keyframes[0].frame);
    return false;
  }
  record(view.frame, pose, local.anchor);
  *rig_from_world = pose.rig_from_world;
  return true;
}

// A frame between key frames of the start, posed first by what the corner tracker saw, which may be all there
// is of a view that was released.
void Odometry::pose_between(const Start& start, const WaitingView& waiting, int view, const LocalMap& local) {
  if (frames_[waiting.frame].segment >= 0) return;  // it was posed as one that turns
  const Map& map = segment().map;
  const MapKeyFrame &a = map.keyframes[local.anchor], &b = map.keyframes[local.anchor + 1];
  const double part =
      double(rank_of(waiting.frame) - rank_of(a.frame)) / double(rank_of(b.frame) - rank_of(a.frame));
  const Rigid3 between = interpolate(a.rig_from_world, b.rig_from_world, part);
  const Localisation seen = localiser_.pose_from_matches(
      map, start.seen[view - start.first_view - 1], static_cast<uint64_t>(rank_of(waiting.frame)), between);
  if (waiting.same_as >= 0) return;
  Rigid3 pose = seen.ok ? seen.rig_from_world : between;
  if (waiting.images() && pose_near(*waiting.images(), local, pose, seen.ok, &pose)) return;
  if (waiting.view) return;
  frames_[waiting.frame].reason = "too little was kept of it while it waited for the start";
  if (seen.ok) record(waiting.frame, seen, local.anchor);
}

// Key frames of the start and the frames between.
void Odometry::pose_start_frames(const Start& start, const std::vector<WaitingView>& views) {
  const Map& map = segment().map;
  LocalMap local;
  int next = 0;  // key frame
  for (int i = start.first_view; next < 3; ++i) {
    if (views[i].frame != map.keyframes[next].frame) {
      pose_between(start, views[i], i, local);
      continue;
    }
    record(views[i].frame, seen_by_keyframe(map.keyframes[next], map), next);
    observer_->keyframe_added({views[i].frame, world(), next});
    local = make_local_map(map, segment().views, rig_, next, kReach);
    ++next;
    if (rig_.scans() && next < 3) localiser_.set_velocity(start_velocity(next));
  }
}

// Frames before the first key frame: back in time while the map reaches.
void Odometry::pose_earlier_frames(const std::vector<WaitingView>& views, int first_view) {
  Rigid3 next = segment().map.keyframes[0].rig_from_world, velocity;
  const LocalMap local = make_local_map(segment().map, segment().views, rig_, 0, kReach);
  if (rig_.scans()) localiser_.set_velocity(start_velocity(1));
  for (int i = first_view - 1; i >= 0; --i) {
    if (!views[i].images()) continue;
    if (frames_[views[i].frame].segment >= 0) break;
    Rigid3 pose;
    if (!pose_near(*views[i].images(), local, velocity * next, false, &pose)) break;
    velocity = pose * next.inverse();
    next = pose;
  }
  for (int i = 0; i < first_view; ++i) {
    FrameRecord& frame = frames_[views[i].frame];
    if (frame.segment < 0 && frame.reason.empty()) {
      frame.reason = fmt::format("before the start at frame {}", segment().map.keyframes[0].frame);
    }
  }
}

// Views that show the same as an earlier one have its pose.
void Odometry::pose_copies(const std::vector<WaitingView>& views) {
  for (const WaitingView& copy : views) {
    if (copy.same_as < 0) continue;
    const FrameRecord& original = frames_[views[copy.same_as].frame];
    FrameRecord& frame = frames_[copy.frame];
    if (frame.segment >= 0 || original.segment != world()) continue;
    frame.segment = original.segment;
    frame.keyframe = original.keyframe;
    frame.rig_from_keyframe = original.rig_from_keyframe;
    frame.covariance = original.covariance;
    frame.reason.clear();
    tell_posed(copy.frame);
  }
}

}  // namespace raysfm
