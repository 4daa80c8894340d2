#include "raysfm/places/map_fusion.h"

#include <algorithm>
#include <numeric>
#include <utility>

namespace raysfm {

void transform_map(const Similarity3& b_from_a, Map* map) {
  for (MapKeyFrame& k : map->keyframes) k.rig_from_world = carried_over(k.rig_from_world, b_from_a);
  for (Track& t : map->tracks) {
    if (t.triangulated) t.position = b_from_a * t.position;
  }
  map->guessed_distance *= b_from_a.scale;
  map->rescaled *= b_from_a.scale;
}

JoinedNumbers join_maps(const Similarity3& first_from_second, Map second, Map* first) {
  transform_map(first_from_second, &second);
  JoinedNumbers numbers;
  numbers.first_track_of_second = static_cast<int>(first->tracks.size());
  std::vector<MapKeyFrame> joined;
  joined.reserve(first->keyframes.size() + second.keyframes.size());
  size_t a = 0, b = 0;
  while (a < first->keyframes.size() || b < second.keyframes.size()) {
    const bool from_first =
        b == second.keyframes.size() ||
        (a < first->keyframes.size() && first->keyframes[a].frame < second.keyframes[b].frame);
    (from_first ? numbers.keyframe_of_first : numbers.keyframe_of_second)
        .push_back(static_cast<int>(joined.size()));
    joined.push_back(std::move(from_first ? first->keyframes[a++] : second.keyframes[b++]));
    if (from_first) continue;
    for (int& track : joined.back().tracks) track += track < 0 ? 0 : numbers.first_track_of_second;
  }
  first->keyframes = std::move(joined);
  for (Track& t : first->tracks) {
    for (TrackObservation& o : t.observations) o.keyframe = numbers.keyframe_of_first[o.keyframe];
  }
  for (Track& t : second.tracks) {
    for (TrackObservation& o : t.observations) o.keyframe = numbers.keyframe_of_second[o.keyframe];
    first->tracks.push_back(std::move(t));
  }
  for (const int t : second.free_tracks) first->free_tracks.push_back(numbers.first_track_of_second + t);
  if (first->guessed_keyframe >= 0)
    first->guessed_keyframe = numbers.keyframe_of_first[first->guessed_keyframe];
  return numbers;
}

bool is_observed(const Map& map, int track, int keyframe, int camera) {
  return std::ranges::any_of(map.tracks[track].observations, [&](const TrackObservation& o) {
    return o.keyframe == keyframe && map.keyframes[keyframe].cameras[o.feature] == camera;
  });
}

void fuse_tracks(int kept, int gone, Map* map) {
  if (kept == gone) return;
  Track &to = map->tracks[kept], &from = map->tracks[gone];
  for (const TrackObservation& o : std::exchange(from.observations, {})) {
    MapKeyFrame& k = map->keyframes[o.keyframe];
    int& track = k.tracks[o.feature];
    track = is_observed(*map, kept, o.keyframe, k.cameras[o.feature]) ? -1 : kept;
    if (track == kept) to.observations.push_back(o);
  }
  std::ranges::stable_sort(to.observations, {}, &TrackObservation::keyframe);
  if (!to.triangulated && from.triangulated) {
    to.position = from.position;
    to.triangulated = to.had_position = true;
  }
  map->free_track(gone);
}

std::vector<int> fuse_points(std::span<const SamePoint> points, Map* map) {
  std::vector<int> track_now(map->tracks.size());
  std::iota(track_now.begin(), track_now.end(), 0);
  for (const SamePoint& p : points) {
    if (track_now[p.here] != p.here || track_now[p.there] != p.there || p.here == p.there) continue;
    fuse_tracks(p.there, p.here, map);
    track_now[p.here] = p.there;
  }
  return track_now;
}

}  // namespace raysfm
