// What Odometry knows, as a Reconstruction.
#include <algorithm>
#include <cmath>
#include <utility>

#include "raysfm/odometry/odometry.h"
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

}  // namespace

Reconstruction Odometry::snapshot() const {
  std::vector<Map> maps;
  for (const SegmentState& s : segments_) maps.push_back(s.map);
  Reconstruction out = assemble(std::move(maps));
  for (PosedFrame& frame : out.frames) {
    if (!frame.world_from_rig && frame.reason.empty()) frame.reason = waiting_reason();
  }
  return out;
}

// From the map of each segment.
Reconstruction Odometry::assemble(std::vector<Map> maps) const {
  Reconstruction out;
  out.rig = rig_.rig();
  out.calibration = refiner_.numbers();
  out.closures = closures_;
  const std::vector<int> number_of = numbers_of_segments();
  out.frames.reserve(frames_.size());
  for (const FrameRecord& f : frames_) {
    PosedFrame& frame = out.frames.emplace_back();
    frame.timestamp = f.timestamp;
    frame.image_name = f.name;
    frame.reason = f.reason;
    if (f.segment < 0) continue;
    frame.segment = number_of[f.segment];
    frame.place_held = f.place_held;
    const Rigid3 rig_from_world = present_pose(f, maps[f.segment]);
    frame.world_from_rig = rig_from_world.inverse();
    frame.covariance = covariance_in_world(rig_from_world, f.covariance);
  }
  reserve_for(maps, &out);
  double squares = 0;
  for (int s = 0; s < static_cast<int>(maps.size()); ++s) {
    if (number_of[s] < 0) continue;
    out.segments.push_back(summary_of(s, maps[s].scale_sigma));
    out.starts.push_back(segments_[s].start);
    squares += assemble_map(number_of[s], std::exchange(maps[s], {}), &out);
  }
  if (const std::vector<int> worlds = worlds_in_order(out); !worlds.empty()) {
    out.metric_scale = out.segments[worlds[0]].metric_scale;
    out.scale_sigma = out.segments[worlds[0]].scale_sigma;
  }
  if (!out.observations.empty()) {
    out.rms_reprojection_px = std::sqrt(squares / static_cast<double>(out.observations.size()));
  }
  return out;
}

// In the result: of the segments that have frames. Others became part of one of these, or were known before
// and not seen.
std::vector<int> Odometry::numbers_of_segments() const {
  std::vector<int> number_of(segments_.size(), -1);
  for (const FrameRecord& f : frames_) {
    if (f.segment >= 0) number_of[f.segment] = 0;
  }
  int next = 0;
  for (int& number : number_of) {
    if (number == 0) number = next++;
  }
  return number_of;
}

// Whether a key frame of this run sees a track.
bool Odometry::is_seen(const Map& map, const Track& track) {
  return std::ranges::any_of(track.observations,
                             [&](const TrackObservation& o) { return map.keyframes[o.keyframe].frame >= 0; });
}

// Points and observations of a segment, behind those of the ones before it. The map is freed meanwhile, so
// that no two copies of it are there at a time. Returns the sum of the squared residuals.
double Odometry::assemble_map(int number, Map map, Reconstruction* out) const {
  double squares = 0;
  std::vector<int> point_of_track(map.tracks.size(), -1);
  for (size_t t = 0; t < map.tracks.size(); ++t) {
    if (!map.tracks[t].triangulated || !is_seen(map, map.tracks[t])) continue;
    point_of_track[t] = static_cast<int>(out->points.size());
    out->points.push_back({map.tracks[t].position, map.tracks[t].rgb, number});
  }
  map.tracks.clear();
  for (MapKeyFrame& kept : map.keyframes) {
    const MapKeyFrame k = std::exchange(kept, {});
    if (k.frame < 0) continue;  // of an earlier run
    KeyFrame keyframe{k.frame, static_cast<int>(out->observations.size()), 0};
    for (int f = 0; f < k.size(); ++f) {
      const int track = k.tracks[f];
      Eigen::Vector2d predicted;
      if (track < 0 || !k.inliers[f] || point_of_track[track] < 0) continue;
      const int camera = k.cameras[f];
      const Eigen::Vector3d point = k.rig_from_world * out->points[point_of_track[track]].position;
      if (!rig_.find(camera, rig_.cam_from_rig(camera) * point, &predicted)) continue;
      const Eigen::Vector2d pixel = k.instant_pixel(f).cast<double>();
      squares += (predicted - pixel).squaredNorm();
      out->observations.push_back({point_of_track[track], camera, pixel});
    }
    keyframe.last_observation = static_cast<int>(out->observations.size());
    out->keyframes.push_back(keyframe);
  }
  return squares;
}

Segment Odometry::summary_of(int number, double scale_sigma) const {
  Segment segment{-1, -1, segments_[number].end_reason, scale_sigma < kMetricSigma, {}};
  if (std::isfinite(scale_sigma)) segment.scale_sigma = scale_sigma;
  for (size_t i = 0; i < frames_.size(); ++i) {
    if (frames_[i].segment != number) continue;
    if (segment.first < 0) segment.first = static_cast<int>(i);
    segment.last = static_cast<int>(i);
  }
  return segment;
}

}  // namespace raysfm
