#include "raysfm/places/meeting.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "raysfm/core/median.h"
#include "raysfm/places/loop_closing.h"

namespace raysfm {
namespace {

// What may have drifted on a path: a part of its length, radians, and the logarithm of the scale with every
// key frame. Where few points go round a corner the scale changes by up to a half: four such corners of a
// corridor that a phone was carried through left a fifth of it, 8e-3 with each key frame.
constexpr double kMostDrift = 0.2, kMostTurn = 0.5, kLeastScaleDrift = 0.1, kScaleDrift = 0.01;
// Of the length of the path: what it usually drifts by at most.
constexpr double kUsualDrift = 0.02;
// Pixels of the octave, half of all points: a map that disagrees with itself by less is not bent, the points
// are only brought together.
constexpr double kDisagreement = 2;
// The same after the drift was spread: key frames near the end that were closed before hold it back.
constexpr double kLeftOver = 3;
// Standard deviations that half of what a key frame sees is off by, of which noise makes 0.2 to 0.6; the part
// of all key frames that may be off by more, some of which fit badly whatever is done.
constexpr double kMisfit = 0.8, kMostUnfit = 0.01;
// Two places tell the same of two worlds: parts of the distance to the points, radians.
constexpr double kSameShift = 0.1, kSameTurn = 0.1, kSameScale = 0.2;

// How far from where the key frame sees it a point of the rig is, standard deviations.
double misfit(const TrackingRig& rig, const MapKeyFrame& k, int feature, const Eigen::Vector3d& point) {
  Eigen::Vector2d residual, pixel;
  bool seen = false;
  if (rig.angular()) {
    seen = k.rays[feature].residual(point, &residual);
  } else {
    const int camera = k.cameras[feature];
    seen = rig.find(camera, rig.cam_from_rig(camera) * point, &pixel);
    residual = pixel - k.instant_pixel(feature).cast<double>();
  }
  return seen ? residual.norm() / octave_side(k.octaves[feature]) : INFINITY;
}

// Of the points that the place has, the median in the key frame.
double disagreement(const Meeting& meeting, const TrackingRig& rig, const Map& map) {
  const MapKeyFrame& k = map.keyframes[meeting.here.keyframe];
  std::vector<double> misfits;
  for (const SamePoint& p : meeting.relation.points) {
    for (const TrackObservation& o : map.tracks[p.here].observations) {
      if (o.keyframe != meeting.here.keyframe) continue;
      misfits.push_back(misfit(rig, k, o.feature, k.rig_from_world * map.tracks[p.there].position));
    }
  }
  return median_of(&misfits);
}

// Of two key frames of one world.
double path_between(const Meeting& meeting, const Map& map) {
  const std::vector<MapKeyFrame>& keyframes = map.keyframes;
  double path = 0;
  for (int k = meeting.there.keyframe; k < meeting.here.keyframe; ++k) {
    path += (keyframes[k].rig_from_world * keyframes[k + 1].rig_from_world.inverse()).translation.norm();
  }
  return path;
}

// Where the place has the key frame, seen from where it is.
Rigid3 drift_of(const Meeting& meeting, const Map& map) {
  return meeting.place.rig_from_world * map.keyframes[meeting.here.keyframe].rig_from_world.inverse();
}

// The better known scale is that of the joined world: where it is that of the second, the first goes there.
// Returns the factor by which.
double agree_on_scale(const Map& from, Similarity3* first_from_second, Map* into) {
  if (!(from.scale_sigma < into->scale_sigma)) return 1;
  const double scale = 1 / first_from_second->scale;
  transform_map({scale, Eigen::Quaterniond::Identity(), Eigen::Vector3d::Zero()}, into);
  into->scale_sigma = from.scale_sigma;
  *first_from_second = {1, first_from_second->rotation, scale * first_from_second->translation};
  return scale;
}

}  // namespace

bool has_same_scale(const TrackingRig& rig, const Map& a, const Map& b) {
  return !rig.central() && std::max(a.scale_sigma, b.scale_sigma) < kMetricSigma;
}

std::vector<int> shared_points(const Map& map, int keyframe) {
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

SeenAndShared seen_and_shared(const Map& map, int keyframe, int other) {
  std::vector<uint8_t> is_there(map.tracks.size(), 0);
  for (const int t : map.keyframes[other].tracks) {
    if (t >= 0) is_there[t] = 1;
  }
  SeenAndShared found;
  for (const int t : map.keyframes[keyframe].tracks) {
    if (t < 0 || !map.tracks[t].triangulated) continue;
    ++found.seen;
    found.shared += is_there[t];
  }
  return found;
}

bool is_plausible(const Meeting& meeting, const Map& map) {
  const Rigid3 drift = drift_of(meeting, map);
  const double log_scale = std::abs(std::log(meeting.relation.there_from_here.scale));
  const double most_log_scale =
      kLeastScaleDrift + kScaleDrift * (meeting.here.keyframe - meeting.there.keyframe);
  // A path whose scale changed on its way is too short or too long by as much.
  const double most_drift = kMostDrift + 1 - std::exp(-log_scale);
  return drift.translation.norm() < most_drift * path_between(meeting, map) &&
         log_so3(drift.rotation).norm() < kMostTurn && log_scale < most_log_scale;
}

bool is_usual(const Meeting& meeting, const Map& map) {
  return drift_of(meeting, map).translation.norm() < kUsualDrift * path_between(meeting, map);
}

bool tell_the_same(const Meeting& meeting, const Meeting& before, const Map& here) {
  if (before.here.world != meeting.here.world || before.there.world != meeting.there.world) return false;
  const MapKeyFrame& k = here.keyframes[meeting.here.keyframe];
  const Similarity3 &now = meeting.relation.there_from_here, &then = before.relation.there_from_here;
  const Eigen::Vector3d center = k.rig_from_world.inverse().translation;
  return (now * center - then * center).norm() < kSameShift * now.scale * median_distance(k, here) &&
         now.rotation.angularDistance(then.rotation) < kSameTurn &&
         std::abs(std::log(now.scale / then.scale)) < kSameScale;
}

bool is_bent(const Meeting& meeting, const TrackingRig& rig, const Map& map) {
  return disagreement(meeting, rig, map) > kDisagreement;
}

bool is_straight(const Meeting& meeting, const TrackingRig& rig, const Map& map) {
  return disagreement(meeting, rig, map) < kLeftOver;
}

bool fits_together(const TrackingRig& rig, const Map& map) {
  std::vector<double> misfits;
  int unfit = 0;
  for (const MapKeyFrame& k : map.keyframes) {
    misfits.clear();
    const Eigen::Matrix3d rotation = k.rig_from_world.rotation.toRotationMatrix();
    for (int f = 0; f < k.size(); ++f) {
      if (k.tracks[f] < 0 || !k.inliers[f] || !map.tracks[k.tracks[f]].triangulated) continue;
      const Eigen::Vector3d& point = map.tracks[k.tracks[f]].position;
      misfits.push_back(misfit(rig, k, f, rotation * point + k.rig_from_world.translation));
    }
    unfit += !misfits.empty() && median_of(&misfits) > kMisfit;
  }
  return unfit <= kMostUnfit * static_cast<double>(map.keyframes.size());
}

void straighten(const Meeting& meeting, const TrackingRig& rig, Map* map) {
  const MapKeyFrame &here = map->keyframes[meeting.here.keyframe],
                    &there = map->keyframes[meeting.there.keyframe];
  const Similarity3 there_from_here = similarity_of(there.rig_from_world) * meeting.relation.there_from_here *
                                      inverse(similarity_of(here.rig_from_world));
  close_loop({meeting.here.keyframe, meeting.there.keyframe, there_from_here},
             has_same_scale(rig, *map, *map), map);
}

JoinedWorlds join_worlds(const Meeting& meeting, WorldMaps worlds) {
  JoinedWorlds joined;
  joined.first = std::min(meeting.here.world, meeting.there.world);
  joined.second = std::max(meeting.here.world, meeting.there.world);
  joined.here_is_first = meeting.here.world == joined.first;
  Map &into = *worlds[joined.first], &from = *worlds[joined.second];
  const Similarity3& there_from_here = meeting.relation.there_from_here;
  joined.first_from_second = joined.here_is_first ? inverse(there_from_here) : there_from_here;
  joined.first_rescaled = agree_on_scale(from, &joined.first_from_second, &into);
  joined.numbers = join_maps(joined.first_from_second, std::exchange(from, {}), &into);
  joined.points = meeting.relation.points;
  for (SamePoint& p : joined.points) {
    (joined.here_is_first ? p.there : p.here) += joined.numbers.first_track_of_second;
    if (joined.here_is_first) std::swap(p.here, p.there);  // the older track goes on
  }
  return joined;
}

}  // namespace raysfm
