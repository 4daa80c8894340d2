#include "raysfm/views/map_result.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "raysfm/scene/worlds.h"

namespace raysfm {
namespace {

// A vector that grows by itself would take three times the memory.
void reserve_for(const std::vector<Map>& maps, Reconstruction* out) {
  size_t observations = 0, points = 0;
  for (const Map& map : maps) {
    for (const MapKeyFrame& k : map.keyframes) observations += std::ranges::count(k.inliers, 1);
    points += std::ranges::count_if(map.tracks, &Track::triangulated);
  }
  out->observations.reserve(observations);
  out->points.reserve(points);
}

bool is_in_result(const Map& map, const Track& track) {
  return track.triangulated && std::ranges::any_of(track.observations, [&](const TrackObservation& o) {
           return map.keyframes[o.keyframe].frame >= 0;
         });
}

// Returns the sum of the squared residuals.
double append_map(const TrackingRig& rig, int segment, Map map, Reconstruction* out) {
  double squares = 0;
  std::vector<int> point_of_track(map.tracks.size(), -1);
  for (size_t t = 0; t < map.tracks.size(); ++t) {
    if (!is_in_result(map, map.tracks[t])) continue;
    point_of_track[t] = static_cast<int>(out->points.size());
    out->points.push_back({map.tracks[t].position, map.tracks[t].rgb, segment});
  }
  map.tracks.clear();
  for (MapKeyFrame& kept : map.keyframes) {
    const MapKeyFrame k = std::exchange(kept, {});
    if (k.frame < 0) continue;
    KeyFrame keyframe{k.frame, static_cast<int>(out->observations.size()), 0};
    for (int f = 0; f < k.size(); ++f) {
      const int track = k.tracks[f];
      Eigen::Vector2d predicted;
      if (track < 0 || !k.inliers[f] || point_of_track[track] < 0) continue;
      const int camera = k.cameras[f];
      const Eigen::Vector3d point = k.rig_from_world * out->points[point_of_track[track]].position;
      if (!rig.find(camera, rig.cam_from_rig(camera) * point, &predicted)) continue;
      const Eigen::Vector2d pixel = k.instant_pixel(f).cast<double>();
      squares += (predicted - pixel).squaredNorm();
      out->observations.push_back({point_of_track[track], camera, pixel});
    }
    keyframe.last_observation = static_cast<int>(out->observations.size());
    out->keyframes.push_back(keyframe);
  }
  return squares;
}

}  // namespace

void append_maps(const TrackingRig& rig, std::vector<Map> maps, std::span<const int> segment_of,
                 Reconstruction* out) {
  reserve_for(maps, out);
  double squares = 0;
  for (size_t m = 0; m < maps.size(); ++m) {
    if (segment_of[m] >= 0) squares += append_map(rig, segment_of[m], std::exchange(maps[m], {}), out);
  }
  if (const std::vector<int> worlds = worlds_in_order(*out); !worlds.empty()) {
    out->metric_scale = out->segments[worlds[0]].metric_scale;
    out->scale_sigma = out->segments[worlds[0]].scale_sigma;
  }
  if (!out->observations.empty()) {
    out->rms_reprojection_px = std::sqrt(squares / static_cast<double>(out->observations.size()));
  }
}

}  // namespace raysfm
