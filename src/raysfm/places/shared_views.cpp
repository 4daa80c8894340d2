#include "raysfm/places/shared_views.h"

#include <algorithm>
#include <cmath>

#include "raysfm/geometry/triangulation.h"

namespace raysfm {
namespace {

// Two patches of one view show the same corner: pixels of the octave. Corners are four apart.
constexpr float kSameCorner = 1.5f;
// Radians between the rays that tell the depth of a point.
constexpr double kLeastParallax = 0.01;
// Standard deviation of the logarithm of the scale up to which worlds are one. Of points far ahead along a
// road it is a third of what the scale is off by.
constexpr double kMostScaleSigma = 0.015;

struct Seen {
  int track = 0;  // there
  int view = 0, match = 0;
};

// By tracks, and of each by key frames.
std::vector<Seen> all_seen(std::span<const SharedView> views) {
  std::vector<Seen> seen;
  for (int v = 0; v < static_cast<int>(views.size()); ++v) {
    for (int m = 0; m < static_cast<int>(views[v].matches.size()); ++m) {
      seen.push_back({views[v].matches[m].track, v, m});
    }
  }
  std::ranges::stable_sort(seen, {}, &Seen::track);
  return seen;
}

// The track with a position whose corner a key frame has where another point was found; -1: there is none.
int track_at(const Map& map, const MapKeyFrame& k, const TrackPixel& match) {
  int nearest = -1;
  float least = kSameCorner * octave_side(match.octave);
  for (int f = 0; f < k.size(); ++f) {
    if (k.cameras[f] != match.camera || k.tracks[f] < 0 || !k.inliers[f]) continue;
    const float off = (k.pixels[f] - match.pixel).norm();
    if (!(off < least) || !map.tracks[k.tracks[f]].triangulated) continue;
    least = off;
    nearest = k.tracks[f];
  }
  return nearest;
}

bool triangulate_in(const TrackingRig& rig, const Map& here, std::span<const SharedView> views,
                    std::span<const Seen> seen, Eigen::Vector3d* position) {
  std::vector<Ray> rays;
  for (const Seen& s : seen) {
    const Camera& camera = rig.camera(views[s.view].matches[s.match].camera);
    Ray ray;
    if (!camera.ray(views[s.view].instant_pixels[s.match].cast<double>(), &ray)) continue;
    const Rigid3 world_from_cam =
        here.keyframes[views[s.view].keyframe].rig_from_world.inverse() * camera.rig_from_cam;
    rays.push_back({world_from_cam * ray.origin, world_from_cam.rotation * ray.direction});
  }
  Triangulation found;
  if (largest_parallax(rays) < kLeastParallax || !triangulate(rays, &found)) return false;
  *position = found.point;
  return true;
}

// Where the world `here` has the points.
std::vector<SharedPoint> find_positions(const TrackingRig& rig, const Map& here,
                                        std::span<const SharedView> views, std::span<const Seen> seen) {
  std::vector<SharedPoint> points;
  for (size_t begin = 0, end = 0; begin < seen.size(); begin = end) {
    while (end < seen.size() && seen[end].track == seen[begin].track) ++end;
    SharedPoint point{seen[begin].track, -1, {}};
    for (size_t i = begin; i < end && point.here < 0; ++i) {
      const SharedView& v = views[seen[i].view];
      point.here = track_at(here, here.keyframes[v.keyframe], v.matches[seen[i].match]);
    }
    if (point.here >= 0) {
      point.position = here.tracks[point.here].position;
    } else if (!triangulate_in(rig, here, views, seen.subspan(begin, end - begin), &point.position)) {
      continue;
    }
    points.push_back(point);
  }
  return points;
}

// Of all places where the views have a point, at least so many must be where the relation puts it.
bool are_seen(const TrackingRig& rig, const Map& here, const Map& there, std::span<const SharedView> views,
              const Similarity3& here_from_there) {
  int looked_at = 0, agreeing = 0;
  for (const SharedView& v : views) {
    const Rigid3& rig_from_here = here.keyframes[v.keyframe].rig_from_world;
    for (size_t i = 0; i < v.matches.size(); ++i) {
      const TrackPixel& m = v.matches[i];
      const Eigen::Vector3d in_rig = rig_from_here * (here_from_there * there.tracks[m.track].position);
      ++looked_at;
      agreeing += is_seen_about(rig, m.camera, m.octave, v.instant_pixels[i], in_rig);
    }
  }
  return agreeing >= kSeenShare * looked_at;
}

}  // namespace

std::optional<SharedPoints> relate_by_views(const TrackingRig& rig, const Map& here, const Map& there,
                                            std::span<const SharedView> views, bool same_scale) {
  if (views.size() < 2) return std::nullopt;
  SharedPoints out;
  out.points = find_positions(rig, here, views, all_seen(views));
  // The view in the middle is nearest to all.
  const SharedView& v = views[views.size() / 2];
  const Rigid3& rig_from_here = here.keyframes[v.keyframe].rig_from_world;
  std::vector<double> log_ratios;
  for (const SharedPoint& p : out.points) {
    const double here_distance = (rig_from_here * p.position).norm();
    const double there_distance = (v.rig_from_there * there.tracks[p.there].position).norm();
    log_ratios.push_back(std::log(there_distance / here_distance));
  }
  const auto scale = scale_of(std::move(log_ratios), same_scale);
  if (!scale || scale->log_sigma > kMostScaleSigma) return std::nullopt;
  out.relation = relation_by(rig_from_here, v.rig_from_there, *scale);
  if (!are_seen(rig, here, there, views, inverse(out.relation.there_from_here))) return std::nullopt;
  return out;
}

}  // namespace raysfm
