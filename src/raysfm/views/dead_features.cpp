#include "raysfm/views/dead_features.h"

#include <algorithm>
#include <iterator>
#include <utility>
#include <vector>

namespace raysfm {
namespace {

// Whether a feature may still be matched, or is part of the map.
bool is_alive(const Map& map, int keyframe, int feature, bool for_good) {
  const MapKeyFrame& k = map.keyframes[keyframe];
  if (k.tracks[feature] < 0) return false;
  const Track& t = map.tracks[k.tracks[feature]];
  if (for_good) return t.triangulated && k.inliers[feature];
  return t.triangulated || t.observations.back().keyframe > keyframe;
}

// Moves elements kept[i] to i and drops the rest, of the memory too. Empty ones stay empty.
template <typename Array>
void keep(const std::vector<int>& kept, Array* values) {
  if (values->empty()) return;
  Array fewer;
  fewer.reserve(kept.size());
  for (const int i : kept) fewer.push_back((*values)[i]);
  *values = std::move(fewer);
}

void keep(const std::vector<int>& kept, PatchSet* patches) {
  if (patches->size() == 0) return;
  PatchSet fewer;
  fewer.resize(static_cast<int>(kept.size()));
  for (size_t i = 0; i < kept.size(); ++i) copy_patch(*patches, kept[i], static_cast<int>(i), &fewer);
  *patches = std::move(fewer);
}

// Without the feature, the track sees nothing there.
void give_up(int keyframe, int feature, Map* map) {
  const int track = map->keyframes[keyframe].tracks[feature];
  if (track < 0) return;
  Track& t = map->tracks[track];
  if (t.had_position) {
    std::erase_if(t.observations,
                  [&](const TrackObservation& o) { return o.keyframe == keyframe && o.feature == feature; });
    return;
  }
  for (const TrackObservation& o : t.observations) map->keyframes[o.keyframe].tracks[o.feature] = -1;
  map->free_track(track);
}

// Described features at their new places.
void keep_described(const std::vector<int>& moved_to, MapKeyFrame* keyframe) {
  std::vector<int> kept;
  for (size_t i = 0; i < keyframe->described.size(); ++i) {
    int& feature = keyframe->described[i];
    feature = moved_to[feature];
    if (feature >= 0) kept.push_back(static_cast<int>(i));
  }
  keep(kept, &keyframe->described);
  keep(kept, &keyframe->descriptors);
}

}  // namespace

void drop_dead_features(int keyframe, bool for_good, Map* map, KeyFrameView* view) {
  MapKeyFrame& k = map->keyframes[keyframe];
  std::vector<int> kept, moved_to(k.size(), -1);
  for (int f = 0; f < k.size(); ++f) {
    if (is_alive(*map, keyframe, f, for_good)) {
      MapArray<TrackObservation>& observations = map->tracks[k.tracks[f]].observations;
      for (TrackObservation& o : observations) {
        if (o.keyframe == keyframe && o.feature == f) o.feature = static_cast<int>(kept.size());
      }
      if (for_good) observations.shrink_to_fit();
      moved_to[f] = static_cast<int>(kept.size());
      kept.push_back(f);
    } else {
      give_up(keyframe, f, map);
    }
  }
  keep(kept, &k.cameras);
  keep(kept, &k.pixels);
  keep(kept, &k.scan_offsets);
  keep(kept, &k.octaves);
  keep(kept, &k.tracks);
  keep(kept, &k.inliers);
  keep(kept, &k.rays);
  keep(kept, &view->cameras);
  keep(kept, &view->pixels);
  keep(kept, &view->octaves);
  keep(kept, &view->origins);
  keep(kept, &view->directions);
  keep(kept, &view->point_jacobians);
  keep(kept, &view->patches);
  keep_described(moved_to, &k);
}

void give_up_marks(const FixedMarks& marks, Map* map) {
  for (int t = 0; t < static_cast<int>(map->tracks.size()); ++t) {
    Track& track = map->tracks[t];
    const auto is_about_mark = [&](const TrackObservation& o) {
      const MapKeyFrame& k = map->keyframes[o.keyframe];
      return marks.covers(k.cameras[o.feature], k.pixels[o.feature]);
    };
    if (2 * std::ranges::count_if(track.observations, is_about_mark) <= std::ssize(track.observations))
      continue;
    for (const TrackObservation& o : track.observations) {
      map->keyframes[o.keyframe].tracks[o.feature] = -1;
      map->keyframes[o.keyframe].inliers[o.feature] = 0;
    }
    track.observations.clear();
    track.triangulated = false;
    if (!track.had_position) map->free_track(t);
  }
}

}  // namespace raysfm
