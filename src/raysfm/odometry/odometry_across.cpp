// How Odometry brings a world that starts together with the one that ended before it: what stopped track from
// going on may not stop the new world from seeing what the old one saw last.
#include <algorithm>
#include <optional>
#include <utility>

#include "raysfm/odometry/odometry.h"
#include "raysfm/places/map_fusion.h"
#include "raysfm/views/scan_correction.h"

namespace raysfm {
namespace {

constexpr int kLookedBackAt = 8;  // key frames of the world that ended, the newest first
constexpr int kMostNotFound = 3;  // of them, one after another

}  // namespace

// The active world, which is not gone on with. What was seen last becomes a key frame of it: it is most like
// what the new world sees.
Odometry::EndedWorld Odometry::end_world() {
  const ViewPtr last = last_seen_->view;
  if (!frames_[last->frame].place_held && segment().map.keyframes.back().frame < last->frame) {
    previous_ = std::exchange(last_seen_, std::nullopt);
    promote_previous(nullptr);
    previous_.reset();
  }
  return {active_, {}, last};
}

// Where the new world sees the images that are left of the one that ended before it, both are one world. From
// the earliest view of the new world time is gone through backwards.
std::optional<Meeting> Odometry::look_across(EndedWorld* ended, const ViewPtr& earliest) {
  std::vector<SharedView> shared;
  goes_back_ = true;
  begin_from(earliest);
  sees_old(ended->last);
  int not_found = 0;
  const int count = static_cast<int>(ended->views.size());
  for (int k = count - 1; k >= std::max(0, count - kLookedBackAt) && not_found < kMostNotFound; --k) {
    const ViewPtr& view = ended->views[k].view;
    if (!view) break;
    not_found = sees_old(view) ? 0 : not_found + 1;
    if (not_found == 0) shared.push_back(shared_view(ended->number, k));
  }
  goes_back_ = false;
  std::ranges::reverse(shared);
  Map& map = segments_[ended->number].map;
  const std::optional<SharedPoints> found =
      relate_by_views(rig_, map, segment().map, shared, has_same_scale(rig_, map, segment().map));
  if (!found) return std::nullopt;
  Meeting meeting{{ended->number, shared.back().keyframe}, {world(), 0}, {}, found->relation};
  meeting.relation.points = tie(*found, shared, ended);
  return meeting;
}

// From a view of the active world that was posed, with what its first key frame sees.
void Odometry::begin_from(const ViewPtr& view) {
  previous_ = Previous{view, {}, {}, 0};
  previous_->pose.rig_from_world = present_pose(frames_[view->frame], segment().map);
  learn_velocity();
  if (rig_.scans()) previous_->pose.motion = present_motion(view->frame);
  set_anchor(0);
}

// Whether track leads from the newest posed view to one of the old world, which is that then.
bool Odometry::sees_old(ViewPtr view) {
  Localisation pose = localise(&view);
  if (!followed(pose, options_)) return false;
  previous_ = following(*previous_, view, std::move(pose));
  return true;
}

// The newest posed view as a key frame of the old world. Of what a rolling shutter did only the turning is
// told where the scale is not.
SharedView Odometry::shared_view(int world, int keyframe) const {
  const MapKeyFrame& k = segments_[world].map.keyframes[keyframe];
  SharedView out{keyframe, previous_->pose.rig_from_world, {}, {}};
  RigMotion motion = rig_.scans() ? keyframe_motion(k) : RigMotion{};
  motion.velocity.head<3>().setZero();
  motion.acceleration.head<3>().setZero();
  for (const PointMatch& m : previous_->pose.matches) {
    const Eigen::Vector3d in_rig = out.rig_from_there * segment().map.tracks[m.track].position;
    const Eigen::Vector2d pixel = m.pixel.cast<double>();
    Eigen::Vector2f offset = Eigen::Vector2f::Zero();
    if (rig_.scans()) scan_offsets(rig_, m.camera, {&in_rig, 1}, motion, {&pixel, 1}, {&offset, 1});
    out.matches.push_back(m);
    out.instant_pixels.push_back(m.pixel - offset);
  }
  return out;
}

// Gives the old world the points that its key frames share with the new one.
std::vector<SamePoint> Odometry::tie(const SharedPoints& shared, std::span<const SharedView> views,
                                     EndedWorld* ended) {
  Map& map = segments_[ended->number].map;
  std::vector<SamePoint> same;
  std::vector<int> track_here(segment().map.tracks.size(), -1);
  for (const SharedPoint& p : shared.points) {
    int here = p.here;
    if (here < 0) {
      here = map.new_track();
      map.tracks[here] = {.position = p.position,
                          .triangulated = true,
                          .rgb = segment().map.tracks[p.there].rgb,
                          .had_position = true};
    }
    track_here[p.there] = here;
    same.push_back({here, p.there});
  }
  for (const SharedView& v : views) {
    MapKeyFrame& k = map.keyframes[v.keyframe];
    const int known = k.size();
    for (TrackPixel m : v.matches) {
      m.track = track_here[m.track];
      if (m.track >= 0 && !is_observed(map, m.track, v.keyframe, m.camera))
        observe(rig_, m, v.keyframe, &map);
    }
    correct_scan(rig_, rig_.scans() ? keyframe_motion(k) : RigMotion{}, known, v.keyframe, &map);
    KeyFrameView& view = ended->views[v.keyframe];
    view = make_keyframe_view(view.view, k, rig_);
  }
  return same;
}

// No more images are kept than of one world.
void Odometry::join_ended(EndedWorld ended, const Meeting& meeting) {
  const int kept = std::max(0, kKeptViews - static_cast<int>(segment().views.size()));
  for (int k = 0; k < static_cast<int>(ended.views.size()) - kept; ++k) ended.views[k] = {};
  segments_[ended.number].views = std::move(ended.views);
  join(meeting);
}

}  // namespace raysfm
