#include "raysfm/places/loop_closing.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "raysfm/places/map_measures.h"
#include "raysfm/places/pose_graph.h"

namespace raysfm {
namespace {

constexpr int kLeastShared = 20;  // points that relate two key frames
constexpr size_t kMostOlder = 4;  // key frames, beside the one before, that each is related to
// Standard deviations of a relation, alike for all: of the translation as a part of the distance to the
// points, of the rotation in radians, of the logarithm of the scale. A gap that nothing bridges is worth
// little.
constexpr double kSigma = 0.01, kGapSigma = 1;

double distance_to_points(const Map& map, int keyframe) {
  const double distance = median_distance(map.keyframes[keyframe], map);
  return distance > 0 ? distance : 1;
}

GraphEdge edge(int from, int to, const Similarity3& to_from_from, double sigma, double distance) {
  return {from, to, to_from_from, sigma * distance, sigma, sigma};
}

GraphEdge edge_as_it_is(const Map& map, int from, int to, double sigma, double distance) {
  const Rigid3& f = map.keyframes[from].rig_from_world;
  return edge(from, to, similarity_of(map.keyframes[to].rig_from_world * f.inverse()), sigma, distance);
}

// What holds a key frame to older ones.
void add_edges(const Map& map, int keyframe, std::vector<GraphEdge>* edges) {
  const std::vector<int> shared = shared_observations(map, keyframe);
  const double distance = distance_to_points(map, keyframe);
  std::vector<std::pair<int, int>> older;  // (minus points, key frame)
  for (int k = 0; k < keyframe - 1; ++k) {
    if (shared[k] >= kLeastShared) older.push_back({-shared[k], k});
  }
  std::ranges::sort(older);
  older.resize(std::min(older.size(), kMostOlder));
  for (const auto& [points, k] : older) {
    edges->push_back(edge_as_it_is(map, k, keyframe, kSigma, distance));
  }
  const bool follows = shared[keyframe - 1] > 0;
  if (follows || older.empty()) {
    edges->push_back(edge_as_it_is(map, keyframe - 1, keyframe, follows ? kSigma : kGapSigma, distance));
  }
}

}  // namespace

void close_loop(const LoopClosure& loop, bool scale_is_known, Map* map) {
  std::vector<Similarity3> before, now;
  std::vector<uint8_t> is_free;
  std::vector<GraphEdge> edges;
  for (int k = 0; k < static_cast<int>(map->keyframes.size()); ++k) {
    before.push_back(similarity_of(map->keyframes[k].rig_from_world));
    is_free.push_back(k > 0);
    if (k > 0) add_edges(*map, k, &edges);
  }
  edges.push_back(
      edge(loop.here, loop.there, loop.there_from_here, kSigma, distance_to_points(*map, loop.there)));
  now = before;
  adjust_graph(now, is_free, edges, {.scale_is_known = scale_is_known});
  for (Track& t : map->tracks) {
    if (!t.triangulated || t.observations.empty()) continue;
    const auto inlier = std::ranges::find_if(t.observations, [&](const TrackObservation& o) {
      return map->keyframes[o.keyframe].inliers[o.feature] != 0;
    });
    const int k = (inlier != t.observations.end() ? *inlier : t.observations.front()).keyframe;
    t.position = inverse(now[k]) * (before[k] * t.position);
  }
  for (size_t k = 0; k < now.size(); ++k) {
    map->keyframes[k].rig_from_world = {now[k].rotation, now[k].translation / now[k].scale};
  }
}

}  // namespace raysfm
