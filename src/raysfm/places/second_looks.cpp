#include "raysfm/places/second_looks.h"

#include <algorithm>
#include <utility>

#include "raysfm/views/dead_features.h"

namespace raysfm {
namespace {

// Part of the points of a key frame.
constexpr double kKnownBefore = 0.3;

bool is_second_look(const Map& map, int keyframe, int apart) {
  int seen = 0, known = 0;
  const MapKeyFrame& k = map.keyframes[keyframe];
  for (int f = 0; f < k.size(); ++f) {
    if (k.tracks[f] < 0 || !k.inliers[f] || !map.tracks[k.tracks[f]].triangulated) continue;
    ++seen;
    known += map.tracks[k.tracks[f]].observations.front().keyframe < keyframe - apart;
  }
  return known > kKnownBefore * seen;
}

// A position that fewer than two views support is none.
void take_back_unsupported(Map* map, Track* track) {
  int support = 0;
  for (const TrackObservation& o : track->observations) {
    support += map->keyframes[o.keyframe].inliers[o.feature];
  }
  if (support < 2) track->triangulated = false;
}

// What is left of the map without the key frames that go: in the key frames before `end` only features of
// points.
void drop_points_of(const std::vector<int>& tracks, int end, Map* map) {
  std::vector<uint8_t> has_lost(end, 0);
  for (const int t : tracks) {
    if (map->tracks[t].observations.empty()) map->free_track(t);
    take_back_unsupported(map, &map->tracks[t]);
    if (map->tracks[t].triangulated) continue;
    for (const TrackObservation& o : map->tracks[t].observations) {
      if (o.keyframe < end) has_lost[o.keyframe] = 1;
    }
  }
  KeyFrameView no_images;
  for (int k = 0; k < end; ++k) {
    if (has_lost[k]) drop_dead_features(k, true, map, &no_images);
  }
  // What never had a position was given up with the features.
  for (const int t : tracks) {
    if (map->tracks[t].observations.empty() && map->tracks[t].had_position) map->free_track(t);
  }
}

}  // namespace

std::vector<uint8_t> second_looks(const Map& map, int begin, int end, int apart) {
  std::vector<uint8_t> are;
  for (int k = begin; k < end; ++k) are.push_back(is_second_look(map, k, apart));
  return are;
}

std::vector<int> drop_keyframes(std::span<const uint8_t> goes, Map* map) {
  std::vector<int> number_now;
  std::vector<MapKeyFrame> staying;
  for (size_t k = 0; k < map->keyframes.size(); ++k) {
    if (k >= goes.size() || !goes[k]) staying.push_back(std::move(map->keyframes[k]));
    number_now.push_back(static_cast<int>(staying.size()) - 1);
  }
  std::vector<int> tracks;  // that go, or lose observations
  for (size_t t = 0; t < map->tracks.size(); ++t) {
    auto& observations = map->tracks[t].observations;
    const auto is_gone = [&](const TrackObservation& o) {
      return o.keyframe < static_cast<int>(goes.size()) && goes[o.keyframe];
    };
    if (std::erase_if(observations, is_gone) > 0) {
      observations.shrink_to_fit();
      tracks.push_back(static_cast<int>(t));
    }
    for (TrackObservation& o : observations) o.keyframe = number_now[o.keyframe];
  }
  map->keyframes = std::move(staying);
  if (map->guessed_keyframe >= 0) map->guessed_keyframe = number_now[map->guessed_keyframe];
  if (!goes.empty()) drop_points_of(tracks, number_now[goes.size() - 1] + 1, map);
  return number_now;
}

}  // namespace raysfm
