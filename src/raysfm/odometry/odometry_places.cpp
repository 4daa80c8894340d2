// How Odometry comes back to where it was.
#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include "raysfm/core/median.h"
#include "raysfm/odometry/odometry.h"
#include "raysfm/places/loop_closing.h"
#include "raysfm/places/map_fusion.h"
#include "raysfm/scene/map_measures.h"

namespace raysfm {
namespace {

// A key frame is a place of its own where it shares less than this part of its points with every other.
constexpr double kSharedWithPlace = 0.5;
constexpr double kSamePlace = 0.3;  // of its described points, that it shares with one that is met again
constexpr double kConnected = 0.2;  // of its points, that it shares with a place that it is tied to
constexpr size_t kLeastDescribed = 40;
// Places looked at closely: those of most votes, where these are more than chance gives: standard deviations
// of a count.
constexpr int kMostLookedAt = 3;
constexpr double kProminent = 5;
// Logarithm to base 10 of the false alarms: of a place that is believed when it fits what is known, and of
// one that needs no other to confirm it.
constexpr double kSignificant = -20, kCertain = -40;
constexpr int kMostRecalled = 5;        // places that a lost view is compared with
constexpr size_t kRecalledPoints = 30;  // of a place without images, to go on from there
// What may have drifted on a path: a part of its length, radians, and the logarithm of the scale with every
// key frame.
constexpr double kMostDrift = 0.2, kMostTurn = 0.5, kLeastScaleDrift = 0.1, kScaleDrift = 0.003;
// Pixels of the octave, half of all points: a map that disagrees with itself by less is not bent, the points
// are only brought together.
constexpr double kDisagreement = 2;
// Key frames of a map that is adjusted as soon as a loop is closed. A larger one would hold up the frame for
// seconds: the graph has spread its drift, and the rest waits for the end.
constexpr size_t kAdjustedAtOnce = 200;
constexpr int kOneVisit = 20;  // key frames from one place seen again to the next, which is no news then
// Two places tell the same of two worlds: parts of the distance to the points, radians.
constexpr double kSameShift = 0.1, kSameTurn = 0.1, kSameScale = 0.2;

std::vector<KeyFrameView> joined_views(const JoinedNumbers& numbers, std::vector<KeyFrameView> first,
                                       std::vector<KeyFrameView> second) {
  std::vector<KeyFrameView> views(numbers.keyframe_of_first.size() + numbers.keyframe_of_second.size());
  for (size_t k = 0; k < first.size(); ++k) views[numbers.keyframe_of_first[k]] = std::move(first[k]);
  for (size_t k = 0; k < second.size(); ++k) views[numbers.keyframe_of_second[k]] = std::move(second[k]);
  return views;
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
    s.views.resize(s.map.keyframes.size());
    for (int k = 0; k < s.looked_about; ++k) {
      MapKeyFrame& keyframe = s.map.keyframes[k];
      keyframe.frame = -left--;
      keyframe.rays.clear();
      for (int f = 0; rig_.angular() && f < keyframe.size(); ++f) {
        ObservedRay& ray = keyframe.rays.emplace_back();
        if (!rig_.observe(keyframe.cameras[f], keyframe.instant_pixel(f), &ray)) keyframe.inliers[f] = 0;
      }
      if (keyframe.described.empty()) continue;
      place_index_.add(keyframe.descriptors);
      places_.push_back({active_, k});
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
    const std::vector<int> shared = shared_points(keyframe);
    if (!is_new_place(keyframe, shared)) continue;
    const size_t before = segment().map.keyframes.size();
    remember(keyframe, shared);
    end += static_cast<int>(segment().map.keyframes.size() - before);  // a world was joined
  }
}

// How many points of a key frame of the active world each key frame sees, itself among them.
std::vector<int> Odometry::shared_points(int keyframe) const {
  const Map& map = segment().map;
  std::vector<int> shared(map.keyframes.size(), 0);
  for (const int t : map.keyframes[keyframe].tracks) {
    if (t < 0 || !map.tracks[t].triangulated) continue;
    int newest = -1;  // a point may be seen in several cameras
    for (const TrackObservation& o : map.tracks[t].observations) {
      shared[o.keyframe] += o.keyframe != std::exchange(newest, o.keyframe);
    }
  }
  return shared;
}

bool Odometry::is_new_place(int keyframe, const std::vector<int>& shared) const {
  const std::vector<MapKeyFrame>& keyframes = segment().map.keyframes;
  for (int k = 0; k < static_cast<int>(shared.size()); ++k) {
    const bool is_place = !keyframes[k].described.empty() || k == segment().newest_place;
    if (is_place && shared[k] > kSharedWithPlace * shared[keyframe]) return false;
  }
  return true;
}

// `shared`: its shared_points().
void Odometry::remember(int keyframe, const std::vector<int>& shared) {
  SegmentState& s = segment();
  MapKeyFrame& k = s.map.keyframes[keyframe];
  describe_keyframe(s.map, *s.views[keyframe].view, describer_, &k);
  if (k.descriptors.size() < kLeastDescribed) return;
  std::vector<uint8_t> is_known;
  for (const PlaceRef& place : places_) {
    const bool here = place.segment == active_;
    // The local map has what is near in time, and tracks tie together what was seen without a gap.
    is_known.push_back(
        here && (s.views[place.keyframe].view || shared[place.keyframe] > kConnected * shared[keyframe]));
  }
  std::vector<PlaceVotes> likely = place_index_.search(k.descriptors, is_known, kMostLookedAt);
  const bool is_only_one = std::ranges::count(is_known, 0) == 1;
  std::erase_if(likely, [&](const PlaceVotes& v) {
    return !is_only_one && v.votes < v.by_chance + kProminent * std::sqrt(v.by_chance);
  });
  s.newest_place = keyframe;
  std::optional<Meeting> meeting = recognise(keyframe, likely);
  const size_t described = k.descriptors.size();
  if (meeting && meeting->there.segment == active_ &&
      static_cast<double>(meeting->relation.points.size()) > kSamePlace * static_cast<double>(described)) {
    k.described.clear();  // the other one is as good
    k.descriptors.clear();
  } else {
    place_index_.add(k.descriptors);
    places_.push_back({active_, keyframe});
  }
  if (!meeting) return;
  if (meeting->there.segment == active_) {
    close(*meeting);
  } else if (is_confirmed(*meeting)) {
    join(*std::move(meeting));
  }
}

// Where two places far from each other are recognised alike, the footage repeats itself and neither is
// believed.
std::optional<Odometry::Meeting> Odometry::recognise(int keyframe, const std::vector<PlaceVotes>& likely) {
  const DescribedCorners seen = described_corners(segment().map.keyframes[keyframe]);
  std::vector<Meeting> meetings;
  for (const PlaceVotes& v : likely) {
    if (auto meeting = meet(keyframe, seen, places_[v.place])) meetings.push_back(*std::move(meeting));
  }
  if (meetings.empty()) return std::nullopt;
  const auto best = std::ranges::max_element(
      meetings, {}, [](const Meeting& m) { return static_cast<int>(m.relation.points.size()); });
  if (best->there.segment == active_ && !is_plausible(*best)) return std::nullopt;
  const MapKeyFrame& here = segment().map.keyframes[keyframe];
  const double distance = best->relation.there_from_here.scale * median_distance(here, segment().map);
  for (const Meeting& other : meetings) {
    if (other.there.segment != best->there.segment) continue;
    const Rigid3 apart = other.place.rig_from_world * best->place.rig_from_world.inverse();
    const bool same =
        apart.translation.norm() < kSameShift * distance && log_so3(apart.rotation).norm() < kSameTurn;
    if (!same && 2 * other.relation.points.size() > best->relation.points.size()) return std::nullopt;
  }
  return std::move(*best);
}

std::optional<Odometry::Meeting> Odometry::meet(int keyframe, const DescribedCorners& seen,
                                                const PlaceRef& there) {
  const Map& map = segments_[there.segment].map;
  const auto frame = static_cast<uint64_t>(segment().map.keyframes[keyframe].frame);
  std::optional<RecognisedPlace> place =
      place_matcher_.recognise(seen, map, there.keyframe, options_.seed, frame);
  if (!place || place->log10_false_alarms > kSignificant) return std::nullopt;
  std::optional<WorldRelation> relation =
      relate_worlds(rig_, segment().map, keyframe, seen, map, *place, has_same_scale(active_, there.segment));
  if (!relation) return std::nullopt;
  return Meeting{{active_, keyframe}, there, *std::move(place), *std::move(relation)};
}

bool Odometry::has_same_scale(int a, int b) const {
  const double sigma = std::max(segments_[a].map.scale_sigma, segments_[b].map.scale_sigma);
  return !rig_.central() && sigma < kMetricSigma;
}

// Whether the path between may have drifted so far.
bool Odometry::is_plausible(const Meeting& meeting) const {
  const std::vector<MapKeyFrame>& keyframes = segment().map.keyframes;
  const Rigid3& here = keyframes[meeting.here.keyframe].rig_from_world;
  double path = 0;
  for (int k = meeting.there.keyframe; k < meeting.here.keyframe; ++k) {
    path += (keyframes[k].rig_from_world * keyframes[k + 1].rig_from_world.inverse()).translation.norm();
  }
  const Rigid3 drift = meeting.place.rig_from_world * here.inverse();
  const double scale_drift =
      kLeastScaleDrift + kScaleDrift * (meeting.here.keyframe - meeting.there.keyframe);
  return drift.translation.norm() < kMostDrift * path && log_so3(drift.rotation).norm() < kMostTurn &&
         std::abs(std::log(meeting.relation.there_from_here.scale)) < scale_drift;
}

// Two worlds are joined where two places say the same, or one says it very clearly.
bool Odometry::is_confirmed(const Meeting& meeting) {
  if (meeting.place.log10_false_alarms < kCertain) return true;
  const std::optional<Meeting> before = std::exchange(hearsay_, meeting);
  if (!before || before->here.segment != meeting.here.segment ||
      before->there.segment != meeting.there.segment) {
    return false;
  }
  const MapKeyFrame& k = segment().map.keyframes[meeting.here.keyframe];
  const Similarity3 &now = meeting.relation.there_from_here, &then = before->relation.there_from_here;
  const Eigen::Vector3d center = k.rig_from_world.inverse().translation;
  return (now * center - then * center).norm() < kSameShift * now.scale * median_distance(k, segment().map) &&
         now.rotation.angularDistance(then.rotation) < kSameTurn &&
         std::abs(std::log(now.scale / then.scale)) < kSameScale;
}

// How far from where the key frame sees them the points are that the place has of them: the median, standard
// deviations.
double Odometry::disagreement(const Meeting& meeting) const {
  const Map& map = segment().map;
  const MapKeyFrame& k = map.keyframes[meeting.here.keyframe];
  std::vector<double> errors;
  for (const SamePoint& p : meeting.relation.points) {
    for (const TrackObservation& o : map.tracks[p.here].observations) {
      if (o.keyframe != meeting.here.keyframe) continue;
      const int camera = k.cameras[o.feature];
      Eigen::Vector2d pixel;
      const Eigen::Vector3d point =
          rig_.cam_from_rig(camera) * (k.rig_from_world * map.tracks[p.there].position);
      const bool seen = rig_.find(camera, point, &pixel);
      errors.push_back(seen ? (pixel - k.instant_pixel(o.feature).cast<double>()).norm() /
                                  octave_side(k.octaves[o.feature])
                            : INFINITY);
    }
  }
  return median_of(&errors);
}

// A loop: the drift along it is spread over all of it, and the points become one.
void Odometry::close(const Meeting& meeting) {
  SegmentState& s = segment();
  Map& map = s.map;
  const MapKeyFrame &here = map.keyframes[meeting.here.keyframe],
                    &there = map.keyframes[meeting.there.keyframe];
  const Rigid3 moved = meeting.place.rig_from_world * here.rig_from_world.inverse();
  const Closure closure{here.frame, std::max(-1, there.frame),
                        static_cast<int>(meeting.relation.points.size()), false,
                        moved.translation.norm() / median_distance(here, map)};
  const bool bent = disagreement(meeting) > kDisagreement;
  if (bent) {
    const std::vector<Rigid3> before = poses_of(active_);
    const Similarity3 there_from_here = similarity_of(there.rig_from_world) *
                                        meeting.relation.there_from_here *
                                        inverse(similarity_of(here.rig_from_world));
    close_loop({meeting.here.keyframe, meeting.there.keyframe, there_from_here},
               has_same_scale(active_, active_), &map);
    carry_frames(active_, before);
  }
  fuse(meeting.relation.points);
  if (bent && map.keyframes.size() <= kAdjustedAtOnce) {
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
  s.closed = true;
}

// The active world after what was brought together in it, in a few steps; the rest is done at the end.
void Odometry::adjust_all() {
  adjust_from(active_, 0, false);
  all_has_moved();
}

// Tracks that show the same points become one, and whatever names them follows.
void Odometry::fuse(const std::vector<SamePoint>& points) {
  Map& map = segment().map;
  std::vector<int> track_now(map.tracks.size());
  std::iota(track_now.begin(), track_now.end(), 0);
  for (const SamePoint& p : points) {
    if (track_now[p.here] != p.here || track_now[p.there] != p.there || p.here == p.there) continue;
    fuse_tracks(p.there, p.here, &map);
    track_now[p.here] = p.there;
  }
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

// The better known scale is that of the joined world: where it is that of the second, the first goes there.
// Returns the relation as it is then.
Similarity3 Odometry::agree_on_scale(int first, int second, Similarity3 first_from_second) {
  Map &into = segments_[first].map, &from = segments_[second].map;
  if (!(from.scale_sigma < into.scale_sigma)) return first_from_second;
  const double scale = 1 / first_from_second.scale;
  transform_map({scale, Eigen::Quaterniond::Identity(), Eigen::Vector3d::Zero()}, &into);
  rescale_frames(first, scale);
  into.scale_sigma = from.scale_sigma;
  return {1, first_from_second.rotation, scale * first_from_second.translation};
}

// Two worlds become one: the one that began later goes into the other, and is tracked on there.
void Odometry::join(Meeting meeting) {
  const int first = std::min(meeting.here.segment, meeting.there.segment);
  const int second = std::max(meeting.here.segment, meeting.there.segment);
  SegmentState &into = segments_[first], &from = segments_[second];
  const bool stays = active_ == first;
  const auto frame_of = [&](const PlaceRef& p) {
    return std::max(-1, segments_[p.segment].map.keyframes[p.keyframe].frame);
  };
  const Closure closure{frame_of(meeting.here), frame_of(meeting.there),
                        static_cast<int>(meeting.relation.points.size()), true, 0};
  const Similarity3& there_from_here = meeting.relation.there_from_here;
  const Similarity3 first_from_second =
      agree_on_scale(first, second, stays ? inverse(there_from_here) : there_from_here);
  const JoinedNumbers numbers = join_maps(first_from_second, std::exchange(from.map, {}), &into.map);
  into.views =
      joined_views(numbers, std::move(into.views), std::exchange(from.views, std::vector<KeyFrameView>()));
  renumber(first, first, numbers.keyframe_of_first, 0);
  rescale_frames(second, first_from_second.scale);
  renumber(second, first, numbers.keyframe_of_second, numbers.first_track_of_second);

  const std::vector<int>& of_active = stays ? numbers.keyframe_of_first : numbers.keyframe_of_second;
  const auto now = [&](int keyframe) { return keyframe < 0 ? keyframe : of_active[keyframe]; };
  const SegmentState& active = segment();
  into.looked_about = now(active.looked_about - 1) + 1;
  into.newest_meeting = now(meeting.here.keyframe);
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
  for (SamePoint& p : meeting.relation.points) {
    (stays ? p.there : p.here) += numbers.first_track_of_second;
    if (stays) std::swap(p.here, p.there);  // the older track goes on
  }
  fuse(meeting.relation.points);
  adjust_all();
  closures_.push_back(closure);
  observer_->place_seen_again({first, closure, second});
  hearsay_.reset();
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
  for (PlaceRef& place : places_) {
    if (place.segment != segment) continue;
    place = {into, keyframes[place.keyframe]};
  }
  refiner_.renumber(segment, into, keyframes);
}

// A view that shows a place of any world goes on there. Where images of the place are at hand, all points
// about it are looked for in the view; elsewhere the corners by which it was recognised must do.
bool Odometry::recall(const ViewPtr& view) {
  if (place_index_.size() == 0) return false;
  const DescribedCorners seen = describe_corners(*view, describer_);
  for (const PlaceVotes& v : place_index_.search(seen.descriptors, {}, kMostRecalled)) {
    const PlaceRef where = places_[v.place];
    const std::optional<RecognisedPlace> place =
        place_matcher_.recognise(seen, segments_[where.segment].map, where.keyframe, options_.seed,
                                 static_cast<uint64_t>(view->frame));
    if (!place) continue;
    if (where.segment == active_ && segment().views[where.keyframe].view) {
      if (take_up(view, where.keyframe, place->rig_from_world)) return true;
    } else if (place->log10_false_alarms < kCertain && place->matches.size() >= kRecalledPoints) {
      take_up_place(view, where, seen, *place);
      return true;
    }
  }
  return false;
}

// The view becomes a key frame of the world that it shows.
void Odometry::take_up_place(const ViewPtr& view, const PlaceRef& where, const DescribedCorners& seen,
                             const RecognisedPlace& place) {
  if (where.segment != active_) segment().views = std::vector<KeyFrameView>();  // as when a world begins
  active_ = where.segment;
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
  mapper_.add_keyframe(view, pose, &s.map, &s.views);
  rescale_frames(active_, s.map.rescaled / rescaled);
  const int keyframe = static_cast<int>(s.map.keyframes.size()) - 1;
  pose.rig_from_world = s.map.keyframes[keyframe].rig_from_world;
  s.looked_about = std::max(s.looked_about, keyframe);
  resume(view, keyframe, std::move(pose));
  observer_->keyframe_added({view->frame, world(), keyframe});
}

}  // namespace raysfm
