// What Odometry does when a world starts: its first frames.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <limits>
#include <utility>

#include "raysfm/geometry/interpolation.h"
#include "raysfm/geometry/similarity.h"
#include "raysfm/odometry/odometry.h"
#include "raysfm/places/map_fusion.h"
#include "raysfm/scene/map_order.h"
#include "raysfm/views/surfaces.h"

namespace raysfm {

void Odometry::start(const ViewPtr& view) {
  ScopedTimer timer(start_timing_);
  const int attempts = starter_->attempts();
  std::optional<Start> start = starter_->push(view, mapper_);
  if (starter_->attempts() > attempts && !start) {
    observer_->start_refused({view->frame, starter_->last_reason()});
  }
  if (starter_->is_crowded() && maker_ && view->frame < evenly_from_) start = start_evenly(std::move(start));
  if (!start) return follow_early_turn(view);
  const std::vector<WaitingView> views = starter_->views();
  starter_.emplace(rig_, options_);
  begin_segment(std::move(*start), views);
}

// What moves may have most of the strong corners: all that waits is gone through again with corners that are
// spread evenly. Where images were released already, they are from the next frame on.
std::optional<Start> Odometry::start_evenly(std::optional<Start> start) {
  const std::vector<WaitingView> views = starter_->views();
  evenly_from_ = views.back().frame + 1;
  if (!std::ranges::all_of(views, [](const WaitingView& v) { return v.view != nullptr; })) return start;
  evenly_from_ = views.front().frame;
  starter_.emplace(rig_, options_);
  start.reset();
  auto next = views.begin();
  while (!start && next != views.end()) start = starter_->push(detected((next++)->view), mapper_);
  for (auto later = views.end(); later != next;) waiting_.push_front((--later)->view);
  return start;
}

void Odometry::begin_segment(Start start, const std::vector<WaitingView>& views) {
  const std::vector<int> chosen = start.summary.frames;
  EndedWorld ended;
  if (!segments_.empty()) {
    // Without a maker, key frames have let their corners go for good.
    if (options_.loops && maker_ != nullptr && last_seen_) ended = end_world();
    ended.views.swap(segment().views);  // what was seen of it is remembered without images
    settle_until(views.front().frame);
  }
  segments_.push_back({std::move(start.map), std::move(start.views), start.summary});
  active_ = static_cast<int>(segments_.size()) - 1;
  last_seen_.reset();
  turner_.end();
  segment().calibration = calibration_;
  motion_watch_.restart();
  observer_->world_started({world(), start.summary});
  follow_errors(segment().map);
  pose_start_frames(start, views);
  if (start.first_view > 0) go_back(views, start.first_view);
  take_early_turn();
  for (int k = 0; const MapKeyFrame& keyframe : segment().map.keyframes) {
    observer_->keyframe_added({keyframe.frame, world(), k++});
  }
  pose_copies(views);
  if (rig_.scans()) refine_start();
  doubt_relief();

  std::optional<Meeting> meeting;
  if (ended.number >= 0) {
    const auto earliest = std::ranges::find_if(
        views, [&](const WaitingView& v) { return v.view && frames_[v.frame].segment == world(); });
    meeting = look_across(&ended, earliest->view);
  }
  const int newest = static_cast<int>(segment().map.keyframes.size()) - 1;
  const auto third = std::ranges::find(views, chosen[2], &WaitingView::frame);
  go_on_from(third->view, newest);
  if (meeting) join_ended(std::move(ended), *meeting);
  for (auto it = views.end(); it != third + 1;) waiting_.push_front((--it)->view);
}

// From a key frame whose view there is, as the newest that was posed.
void Odometry::go_on_from(const ViewPtr& view, int keyframe) {
  const Map& map = segment().map;
  previous_ = Previous{view, seen_by_keyframe(map.keyframes[keyframe], map), {}, 0};
  learn_velocity();
  if (rig_.scans()) previous_->pose.motion = present_motion(view->frame);
  set_anchor(keyframe);
}

// Poses a frame of the start against the key frame nearest in time, and records it. Without corners where it
// has none any more.
bool Odometry::pose_near(const View& view, const LocalMap& local, const Rigid3& predicted, bool sure) {
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
  const Rigid3& pose = seen.ok ? seen.rig_from_world : between;
  if (waiting.images() && pose_near(*waiting.images(), local, pose, seen.ok)) return;
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
    local = make_local_map(map, segment().views, rig_, next, kLocalReach);
    ++next;
    if (rig_.scans() && next < 3) localiser_.set_motion(start_motion(next));
  }
}

// Frames before the first key frame.
void Odometry::go_back(const std::vector<WaitingView>& views, int first_view) {
  const auto is_posed = [&](int v) { return frames_[views[v].frame].segment >= 0; };
  int end = first_view;
  while (end > 0 && !is_posed(end - 1)) --end;  // before it are those that were posed as a turn
  goes_back_ = true;
  if (options_.departures.earlier) grow_back(views, end, first_view);
  pose_earlier_frames(views, end, first_view);
  goes_back_ = false;
  hang_on_earlier_keyframes();
  for (int v = 0; v < first_view; ++v) {
    FrameRecord& frame = frames_[views[v].frame];
    if (v >= end && frame.segment >= 0) tell_posed(views[v].frame);
    if (frame.segment >= 0 || !frame.reason.empty()) continue;
    frame.reason = fmt::format("before the start at frame {}", views[first_view].frame);
  }
}

// Back in time while the map reaches: it grows by key frames there as it does by later ones. They may have
// seen from farther away what the three views of the start saw from close together.
void Odometry::grow_back(const std::vector<WaitingView>& views, int end, int first_view) {
  Map& map = segment().map;
  const size_t started = map.keyframes.size();
  const double rescaled = map.rescaled;
  reverse_time();
  go_on_from(views[first_view].view, static_cast<int>(started) - 1);
  for (int v = first_view - 1; v >= end && map.keyframes.size() < kKeptViews; --v) {
    ViewPtr view = views[v].view;
    if (view && !go_on(&view).empty()) break;
  }
  reverse_time();
  if (map.keyframes.size() == started) return;
  transform_map(similarity_of(map.keyframes[0].rig_from_world), &map);
  map.keyframes[0].rig_from_world = {};
  follow_errors(map);
  const int old = static_cast<int>(map.keyframes.size()) - kFollowedFor;
  for (int k = 0; k < old; ++k) drop_dead_features(k, false);
  // Poses of the start were told already.
  observer_->map_adjusted({world(), views[end].frame, map.keyframes.back().frame, map.rescaled / rescaled});
}

// The others, of some of which only coarse images were kept: each by the key frame after it. Where none
// before it is posed, while the map reaches.
void Odometry::pose_earlier_frames(const std::vector<WaitingView>& views, int end, int first_view) {
  const Map& map = segment().map;
  const auto is_posed = [&](const WaitingView& v) { return frames_[v.frame].segment == world(); };
  const auto between = [&](int a, int b, int frame) {
    const double part = double(rank_of(frame) - rank_of(a)) / double(rank_of(b) - rank_of(a));
    return interpolate(present_pose(frames_[a], map), present_pose(frames_[b], map), part);
  };
  int next = views[first_view].frame;
  int after_next = std::find_if(views.begin() + first_view + 1, views.end(), is_posed)->frame;
  LocalMap local;
  local.anchor = -1;
  if (rig_.scans()) localiser_.set_motion(present_motion(next));
  for (int v = first_view - 1; v >= end; --v) {
    const int frame = views[v].frame;
    if (!is_posed(views[v])) {
      if (!views[v].images()) continue;
      const auto earlier = std::find_if(views.rend() - v, views.rend() - end, is_posed);
      const bool is_last = earlier == views.rend() - end;
      const Rigid3 predicted =
          is_last ? between(next, after_next, frame) : between(earlier->frame, next, frame);
      int anchor = 0;
      while (map.keyframes[anchor].frame < frame) ++anchor;
      if (anchor != local.anchor) local = make_local_map(map, segment().views, rig_, anchor, kLocalReach);
      if (!pose_near(*views[v].images(), local, predicted, false)) {
        if (is_last) break;
        continue;
      }
    }
    after_next = std::exchange(next, frame);
  }
}

// The newest key frame of the active world becomes the first.
void Odometry::reverse_time() {
  SegmentState& s = segment();
  const int last = static_cast<int>(s.map.keyframes.size()) - 1;
  reverse_keyframes(&s.map);
  std::ranges::reverse(s.views);
  for (FrameRecord& frame : frames_) {
    if (frame.segment == world()) frame.keyframe = last - frame.keyframe;
  }
}

// What was posed back in time hangs on the key frame after it.
void Odometry::hang_on_earlier_keyframes() {
  const Map& map = segment().map;
  for (int f = 0; f < frames(); ++f) {
    FrameRecord& frame = frames_[f];
    if (frame.segment != world()) continue;
    int before = frame.keyframe;
    while (before > 0 && map.keyframes[before].frame > f) --before;
    if (before != frame.keyframe) hang_on(before, map, &frame);
  }
}

// Through a narrow lens the three views of a start may look the same as those of a world inside out, and
// before a plane as those of another motion. More key frames tell.
void Odometry::doubt_relief() {
  constexpr std::array kDoubted = {4, 6, 9, 14, 20};  // key frames
  SegmentState& s = segment();
  const auto keyframes = static_cast<int>(s.map.keyframes.size());
  if (keyframes < s.relief_due || s.map.keyframes[0].frame < 0) return;
  constexpr int kNever = std::numeric_limits<int>::max();
  const auto* next = std::ranges::upper_bound(kDoubted, keyframes);
  s.relief_due = next == kDoubted.end() ? kNever : *next;
  std::vector<Rigid3> before;
  for (const MapKeyFrame& k : s.map.keyframes) before.push_back(k.rig_from_world);
  const Relief relief = mapper_.choose_relief(&s.map);
  if (relief == Relief::kSurelyStays) s.relief_due = kNever;
  if (relief != Relief::kReversed) return;
  carry_frames(world(), before);
  refine_start();
  for (int k = 0; k < keyframes; ++k) {
    if (s.views[k].view) fit_surfaces(rig_, s.map, k, &s.views[k]);
  }
  if (tracking()) learn_velocity();
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
