// How Odometry comes back to where it was.
#include <algorithm>
#include <iterator>
#include <utility>

#include "raysfm/core/median.h"
#include "raysfm/odometry/odometry.h"
#include "raysfm/places/map_fusion.h"
#include "raysfm/places/second_looks.h"

namespace raysfm {
namespace {

// A key frame is a place of its own where it shares less than this part of its points with every other.
constexpr double kSharedWithPlace = 0.5;
constexpr size_t kLeastDescribed = 40;
constexpr int kMostRecalled = 5;        // places that a lost view is compared with
constexpr size_t kRecalledPoints = 30;  // of a place without images, to go on from there
// Logarithm to base 10 of those of a place whose points are then found in the view as well, by their patches.
constexpr double kMostFalseAlarms = -10;
// Key frames whose points tell where track ended. Of 1, 3 and 6 with 423, 697 and 1015 points, the last tells
// a room most often.
constexpr int kEndKeyFrames = 6;
// So many first key frames of a world, places of their own or not, are compared with the ends of others: what
// comes next is most like it, and two looks tell more than one.
constexpr int kNearEnd = 20;
constexpr int kOneVisit = 20;  // key frames from one place seen again to the next, which is no news then
// Of second looks every so manieth key frame stays; they are gone through so many at once.
constexpr int kStays = 10, kThinnedAtOnce = 60;

std::vector<KeyFrameView> joined_views(const JoinedNumbers& numbers, std::vector<KeyFrameView> first,
                                       std::vector<KeyFrameView> second) {
  std::vector<KeyFrameView> views(numbers.keyframe_of_first.size() + numbers.keyframe_of_second.size());
  for (size_t k = 0; k < first.size(); ++k) views[numbers.keyframe_of_first[k]] = std::move(first[k]);
  for (size_t k = 0; k < second.size(); ++k) views[numbers.keyframe_of_second[k]] = std::move(second[k]);
  return views;
}

std::vector<TrackPixel> triangulated_corners(const Map& map, int keyframe) {
  const MapKeyFrame& k = map.keyframes[keyframe];
  std::vector<TrackPixel> corners;
  for (int f = 0; f < k.size(); ++f) {
    const int track = k.tracks[f];
    if (track < 0 || !k.inliers[f] || !map.tracks[track].triangulated) continue;
    corners.push_back({track, k.cameras[f], k.octaves[f], k.pixels[f]});
  }
  return corners;
}

// What is marked of the key frames of two worlds, of those of the joined one before `end`.
std::vector<uint8_t> joined_marks(const JoinedNumbers& numbers, std::span<const uint8_t> first,
                                  std::span<const uint8_t> second, int end) {
  std::vector<uint8_t> marks(end, 0);
  const auto mark = [&](std::span<const uint8_t> of_world, std::span<const int> now) {
    for (size_t k = 0; k < of_world.size(); ++k) {
      if (of_world[k] && now[k] < end) marks[now[k]] = 1;
    }
  };
  mark(first, numbers.keyframe_of_first);
  mark(second, numbers.keyframe_of_second);
  return marks;
}

}  // namespace

void Odometry::know(std::vector<Map> worlds) {
  int left = 0;
  for (const Map& map : worlds) left += static_cast<int>(map.keyframes.size());
  for (Map& map : worlds) {
    if (map.keyframes.empty()) continue;
    active_ = static_cast<int>(segments_.size());
    SegmentState& s = segments_.emplace_back();
    s.map = std::move(map);
    s.start.method = "saved map";
    s.end_reason = "not recognised in the saved map";
    s.looked_about = static_cast<int>(s.map.keyframes.size());
    s.is_known.assign(s.map.keyframes.size(), 0);
    s.views.resize(s.map.keyframes.size());
    for (int k = 0; k < s.looked_about; ++k) {
      MapKeyFrame& keyframe = s.map.keyframes[k];
      keyframe.frame = -left--;
      renew_rays(rig_, &keyframe);
      if (keyframe.described.empty()) continue;
      places_.add({active_, k}, keyframe);
    }
  }
}

// Remembers the places among the key frames of the active world before `end` that were not looked at yet, and
// looks whether they were seen before.
void Odometry::look_about(int end) {
  if (!options_.loops) return;
  while (segment().looked_about < end) {
    const int keyframe = segment().looked_about++;
    if (!segment().views[keyframe].view) continue;
    const size_t before = segment().map.keyframes.size();
    if (is_new_place(keyframe)) {
      remember(keyframe);
    } else if (keyframe < kNearEnd) {
      look_for_ends(keyframe);
    }
    end += static_cast<int>(segment().map.keyframes.size() - before);  // a world was joined
  }
}

// The last key frame of the active world, though it is hardly a new place: what is seen next is most like it.
void Odometry::remember_end() {
  look_about(static_cast<int>(segment().map.keyframes.size()));
  const int newest = static_cast<int>(segment().map.keyframes.size()) - 1;
  if (!options_.loops || !segment().views[newest].view) return;
  if (segment().map.keyframes[newest].described.empty()) remember(newest);
}

// What was seen last of the active world: the points of its newest key frames, as the newest of them saw
// each.
void Odometry::add_end() {
  if (!options_.loops) return;
  const SegmentState& s = segment();
  const int newest = static_cast<int>(s.map.keyframes.size()) - 1;
  TrackEnd end{active_, newest, {}, {}};
  std::vector<uint8_t> is_taken(s.map.tracks.size(), 0);
  for (int k = newest; k >= 0 && k > newest - kEndKeyFrames && s.views[k].view; --k) {
    DescribedCorners seen;
    for (const TrackPixel& corner : triangulated_corners(s.map, k)) {
      if (!std::exchange(is_taken[corner.track], 1)) seen.corners.push_back(corner);
    }
    describe_upright(*s.views[k].view, describer_, &seen);
    std::ranges::move(seen.corners, std::back_inserter(end.corners));
    std::ranges::move(seen.upright, std::back_inserter(end.upright));
  }
  if (!end.corners.empty()) places_.add_end(std::move(end));
}

std::vector<Map*> Odometry::maps() {
  std::vector<Map*> maps;
  for (SegmentState& s : segments_) maps.push_back(&s.map);
  return maps;
}

bool Odometry::is_new_place(int keyframe) const {
  const std::vector<MapKeyFrame>& keyframes = segment().map.keyframes;
  // Most key frames are near the newest place, which is soon found out.
  if (const int newest = segment().newest_place; newest >= 0 && newest != keyframe) {
    const auto [seen, shared] = seen_and_shared(segment().map, keyframe, newest);
    if (shared > kSharedWithPlace * seen) return false;
  }
  const std::vector<int> shared = shared_points(segment().map, keyframe);
  for (int k = 0; k < static_cast<int>(shared.size()); ++k) {
    const bool is_place = !keyframes[k].described.empty() || k == segment().newest_place;
    if (is_place && shared[k] > kSharedWithPlace * shared[keyframe]) return false;
  }
  return true;
}

void Odometry::remember(int keyframe) {
  SegmentState& s = segment();
  MapKeyFrame& k = s.map.keyframes[keyframe];
  describe_keyframe(s.map, *s.views[keyframe].view, describer_, &k);
  if (k.descriptors.size() < kLeastDescribed) return;
  s.newest_place = keyframe;
  const std::vector<Map*> worlds = maps();
  const auto at_hand = [&](int number) {
    const PlaceRef& place = places_.place(number);
    return place.world == active_ && s.views[place.keyframe].view;
  };
  std::optional<Meeting> meeting = places_.meet({active_, keyframe}, worlds, at_hand);
  if (meeting && meeting->there.world == active_) {
    if (is_usual(*meeting, s.map) || places_.is_told_again(*meeting, worlds)) close(*meeting);
  } else if (meeting && places_.is_confirmed(*meeting, worlds)) {
    join(*meeting);
  } else if (!meeting) {
    look_for_ends(keyframe);
  }
}

// Joins the world where track ended in another, if a key frame shows that.
void Odometry::look_for_ends(int keyframe) {
  if (!places_.has_end_outside(active_)) return;
  const SegmentState& s = segment();
  DescribedCorners seen{triangulated_corners(s.map, keyframe), {}, {}};
  describe_upright(*s.views[keyframe].view, describer_, &seen);
  const std::vector<Map*> worlds = maps();
  const std::optional<Meeting> meeting = places_.meet_end({active_, keyframe}, seen, worlds);
  if (meeting && places_.is_confirmed(*meeting, worlds, kCertainEnd)) join(*meeting);
}

// A loop: the drift along it is spread over all of it, and the points become one. All is adjusted where that
// leaves points off from where they are seen.
void Odometry::close(const Meeting& meeting) {
  SegmentState& s = segment();
  Map& map = s.map;
  const MapKeyFrame &here = map.keyframes[meeting.here.keyframe],
                    &there = map.keyframes[meeting.there.keyframe];
  const Rigid3 moved = meeting.place.rig_from_world * here.rig_from_world.inverse();
  const Closure closure{here.frame, std::max(-1, there.frame),
                        static_cast<int>(meeting.relation.points.size()), false,
                        moved.translation.norm() / median_distance(here, map)};
  const bool bent = is_bent(meeting, rig_, map);
  if (bent) {
    adjust(active_, [&](Map* bent_map) { straighten(meeting, rig_, bent_map); });
  }
  const bool straight = !bent || is_straight(meeting, rig_, map);
  fuse(meeting.relation.points);
  // What straightens a large map leaves little to be done, the more often it was closed before.
  if (bent && (map.keyframes.size() <= kLargeMap || !straight || !fits_together(rig_, map))) {
    adjust_all();
  } else {
    all_has_moved();
  }
  const bool same_visit =
      meeting.here.keyframe - std::exchange(s.newest_meeting, meeting.here.keyframe) < kOneVisit;
  if (bent || !same_visit) {
    closures_.push_back(closure);
    observer_->place_seen_again({active_, closure, -1});
  }
  if (!std::exchange(s.closed, true)) s.is_known.resize(meeting.here.keyframe, 0);
}

// Most key frames of a second look have done what they were for once they are old: tracking needed their
// images and points. What names them names the one before that stays, and goes on from there.
void Odometry::drop_second_looks() {
  SegmentState& s = segment();
  const int count = static_cast<int>(s.map.keyframes.size()), begin = static_cast<int>(s.is_known.size());
  const int end = count - kKeptViews - 2 * options_.window;
  if (!s.closed || count <= options_.keep_all_until || end - begin < kThinnedAtOnce) return;
  std::ranges::copy(second_looks(s.map, begin, end, kKeptViews), std::back_inserter(s.is_known));
  std::vector<uint8_t> goes(end, 0);
  for (int k = begin, stays = begin - 1; k < end; ++k) {
    if (s.is_known[k]) s.map.keyframes[k].described.clear(), s.map.keyframes[k].descriptors.clear();
    goes[k] = s.is_known[k] && k - stays < kStays && k != s.map.guessed_keyframe;
    if (!goes[k]) stays = k;
  }
  rehang_frames(goes);
  const std::vector<int> now = drop_keyframes(goes, &s.map);
  renumber(active_, active_, now, 0);
  places_.drop(active_, s.is_known, now);
  for (int k = end; k-- > begin;) {
    if (!goes[k]) continue;
    s.views.erase(s.views.begin() + k);
    s.is_known.erase(s.is_known.begin() + k);
  }
  s.looked_about = now[s.looked_about - 1] + 1;
  if (s.newest_place >= 0) s.newest_place = now[s.newest_place];
  if (s.newest_meeting >= 0) s.newest_meeting = now[s.newest_meeting];
  set_anchor(now[local_.anchor]);
}

// Frames of key frames that go hang on the one before that stays.
void Odometry::rehang_frames(std::span<const uint8_t> goes) {
  for (FrameRecord& frame : frames_) {
    if (frame.segment != active_ || frame.keyframe >= static_cast<int>(goes.size())) continue;
    int stays = frame.keyframe;
    while (goes[stays]) --stays;
    if (stays != frame.keyframe) hang_on(stays, segment().map, &frame);
  }
}

// The active world after what was brought together in it, in a few steps, and a large one by some of its
// points; the rest is done at the end.
void Odometry::adjust_all() {
  if (segment().map.keyframes.size() <= kLargeMap) {
    adjust_from(active_, 0, Adaption::kTwoSeries);
  } else {
    adjust(active_, [&](Map* map) { mapper_.adjust_thinned(map); });
  }
  all_has_moved();
}

// Tracks that show the same points become one, and whatever names them follows.
void Odometry::fuse(const std::vector<SamePoint>& points) {
  const std::vector<int> track_now = fuse_points(points, &segment().map);
  places_.rename_tracks(active_, track_now);
  const auto rename = [&](auto* matches) {
    for (auto& m : *matches) m.track = track_now[m.track];
  };
  if (previous_) rename(&previous_->pose.matches);
  for (size_t f = settled_before_; f < frames_.size(); ++f) {
    if (frames_[f].segment == active_) rename(&frames_[f].matches);
  }
}

// The newest pose and the local map, from the map as it is now.
void Odometry::all_has_moved() {
  if (!previous_) return;
  previous_->pose.rig_from_world = present_pose(frames_[previous_->view->frame], segment().map);
  set_anchor(local_.anchor);
}

// Two worlds become one, of which one is active: the one that began later goes into the other, and is tracked
// on there.
void Odometry::join(const Meeting& meeting) {
  const auto frame_of = [&](const PlaceRef& p) {
    return std::max(-1, segments_[p.world].map.keyframes[p.keyframe].frame);
  };
  const bool from_active = meeting.here.world == active_;
  const PlaceRef &here = from_active ? meeting.here : meeting.there,
                 &there = from_active ? meeting.there : meeting.here;
  const Closure closure{frame_of(here), frame_of(there), static_cast<int>(meeting.relation.points.size()),
                        true, 0};
  const JoinedWorlds joined = join_worlds(meeting, maps());
  const int first = joined.first, second = joined.second;
  const JoinedNumbers& numbers = joined.numbers;
  SegmentState &into = segments_[first], &from = segments_[second];
  into.views =
      joined_views(numbers, std::move(into.views), std::exchange(from.views, std::vector<KeyFrameView>()));
  rescale_frames(first, joined.first_rescaled);
  renumber(first, first, numbers.keyframe_of_first, 0);
  rescale_frames(second, joined.first_from_second.scale);
  renumber(second, first, numbers.keyframe_of_second, numbers.first_track_of_second);
  places_.renumber(joined);

  const bool stays = first == active_;
  const std::vector<int>& of_active = stays ? numbers.keyframe_of_first : numbers.keyframe_of_second;
  const auto now = [&](int keyframe) { return keyframe < 0 ? keyframe : of_active[keyframe]; };
  const SegmentState& active = segment();
  into.looked_about = active.looked_about > 0 ? now(active.looked_about - 1) + 1 : now(0);
  into.newest_meeting = now(here.keyframe);
  into.is_known = joined_marks(numbers, into.is_known, from.is_known, into.newest_meeting);
  into.newest_place = now(active.newest_place);
  into.end_reason = active.end_reason;
  into.calibration = std::min(into.calibration, from.calibration);
  into.closed = true;
  from.joined_into = first;
  local_.anchor = now(local_.anchor);
  active_ = first;
  if (previous_ && !stays) {
    for (PointMatch& m : previous_->pose.matches) m.track += numbers.first_track_of_second;
  }
  fuse(joined.points);
  adjust_all();
  closures_.push_back(closure);
  observer_->place_seen_again({first, closure, second});
}

// What names key frames and tracks of a segment that became part of another, or whose key frames moved to
// make room.
void Odometry::renumber(int segment, int into, const std::vector<int>& keyframes, int first_track) {
  for (FrameRecord& frame : frames_) {
    if (frame.segment != segment) continue;
    frame.segment = into;
    frame.keyframe = keyframes[frame.keyframe];
    for (TrackPixel& m : frame.matches) m.track += first_track;
  }
  refiner_.renumber(segment, into, keyframes);
  map_covariance_.renumber(segment, into);
}

// A view that shows a place of any world goes on there. Where images of the place are at hand, all points
// about it are looked for in the view; elsewhere the corners by which it was recognised must do.
bool Odometry::recall(const ViewPtr& view) {
  if (places_.size() == 0) return false;
  const DescribedCorners seen = describe_corners(*view, describer_);
  for (const PlaceRef& where : places_.most_like(seen, kMostRecalled)) {
    const std::optional<RecognisedPlace> place = places_.recognise(seen, maps(), where, view->frame);
    if (!place) continue;
    if (where.world == active_ && segment().views[where.keyframe].view) {
      const bool corners_agree = place->log10_false_alarms < kMostFalseAlarms;
      if (take_up(view, where.keyframe, place->rig_from_world, corners_agree)) return true;
    } else if (place->log10_false_alarms < kCertainPlace && place->matches.size() >= kRecalledPoints) {
      take_up_place(view, where, seen, *place);
      return true;
    }
  }
  return false;
}

// The view becomes a key frame of the world that it shows.
void Odometry::take_up_place(const ViewPtr& view, const PlaceRef& where, const DescribedCorners& seen,
                             const RecognisedPlace& place) {
  if (where.world != active_) segment().views = std::vector<KeyFrameView>();  // as when a world begins
  active_ = where.world;
  SegmentState& s = segment();
  s.views.resize(s.map.keyframes.size());
  Localisation pose;
  pose.ok = true;
  pose.rig_from_world = place.rig_from_world;
  pose.covariance = place.covariance;
  for (const CornerOfTrack& m : place.matches) {
    TrackPixel corner = seen.corners[m.corner];
    corner.track = m.track;
    pose.matches.push_back({corner, true});
  }
  const double rescaled = s.map.rescaled;
  mapper_.add_keyframe(view, pose, Adjusting::kNow, &s.map, &s.views);
  rescale_frames(active_, s.map.rescaled / rescaled);
  const int keyframe = static_cast<int>(s.map.keyframes.size()) - 1;
  pose.rig_from_world = s.map.keyframes[keyframe].rig_from_world;
  s.looked_about = std::max(s.looked_about, keyframe);
  resume(view, keyframe, std::move(pose));
  observer_->keyframe_added({view->frame, world(), keyframe});
}

}  // namespace raysfm
