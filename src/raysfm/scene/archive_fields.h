#pragma once

#include "raysfm/core/archive.h"
#include "raysfm/core/timer.h"
#include "raysfm/geometry/similarity.h"
#include "raysfm/scene/map.h"
#include "raysfm/scene/reconstruction.h"

namespace raysfm {

// Maps and what is known of frames, for core/archive.h.

template <typename A>
void archive_fields(A& a, StageTiming& x) {
  archive(a, x.total_ms, x.max_ms, x.count, x.samples_ms);
}
template <typename A>
void archive_fields(A& a, Rigid3& x) {
  archive(a, x.rotation, x.translation);
}
template <typename A>
void archive_fields(A& a, Similarity3& x) {
  archive(a, x.scale, x.rotation, x.translation);
}
template <typename A>
void archive_fields(A& a, ObservedRay& x) {
  archive(a, x.origin, x.direction, x.tangents);
}
template <typename A>
void archive_fields(A& a, TrackPixel& x) {
  archive(a, x.track, x.camera, x.octave, x.pixel);
}
template <typename A>
void archive_fields(A& a, Track& x) {
  archive(a, x.position, x.triangulated, x.rgb, x.had_position, x.observations);
}
template <typename A>
void archive_fields(A& a, MapKeyFrame& x) {
  archive(a, x.frame, x.rig_from_world, x.cameras, x.pixels, x.scan_offsets, x.octaves, x.tracks, x.inliers,
          x.rays, x.described, x.descriptors);
}
template <typename A>
void archive_fields(A& a, Map& x) {
  archive(a, x.keyframes, x.tracks, x.free_tracks, x.scale_sigma, x.guessed_keyframe, x.guessed_distance,
          x.rescaled);
}
template <typename A>
void archive_fields(A& a, StartSummary& x) {
  archive(a, x.method, x.frames, x.inliers);
}
template <typename A>
void archive_fields(A& a, Closure& x) {
  archive(a, x.frame, x.with_frame, x.inliers, x.joined_worlds, x.correction);
}

}  // namespace raysfm
