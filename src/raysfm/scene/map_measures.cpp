#include "raysfm/scene/map_measures.h"

#include "raysfm/core/median.h"

namespace raysfm {

double median_distance(const MapKeyFrame& keyframe, const Map& map) {
  const Eigen::Vector3d center = keyframe.rig_from_world.inverse().translation;
  std::vector<double> distances;
  for (int f = 0; f < keyframe.size(); ++f) {
    const int t = keyframe.tracks[f];
    if (t < 0 || !keyframe.inliers[f] || !map.tracks[t].triangulated) continue;
    distances.push_back((map.tracks[t].position - center).norm());
  }
  return median_of(&distances);
}

std::vector<int> shared_observations(const Map& map, int keyframe) {
  std::vector<int> shared(map.keyframes.size(), 0);
  for (const int t : map.keyframes[keyframe].tracks) {
    if (t < 0 || !map.tracks[t].triangulated) continue;
    for (const TrackObservation& o : map.tracks[t].observations) ++shared[o.keyframe];
  }
  return shared;
}

}  // namespace raysfm
