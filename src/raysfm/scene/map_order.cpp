#include "raysfm/scene/map_order.h"

#include <algorithm>

namespace raysfm {

void reverse_keyframes(Map* map) {
  const int last = static_cast<int>(map->keyframes.size()) - 1;
  std::ranges::reverse(map->keyframes);
  for (Track& t : map->tracks) {
    std::ranges::reverse(t.observations);
    for (TrackObservation& o : t.observations) o.keyframe = last - o.keyframe;
  }
  if (map->guessed_keyframe < 0) return;
  const auto place = [&](int k) { return map->keyframes[k].rig_from_world.inverse().translation; };
  map->guessed_keyframe = last;
  map->guessed_distance = (place(last) - place(0)).norm();
}

}  // namespace raysfm
