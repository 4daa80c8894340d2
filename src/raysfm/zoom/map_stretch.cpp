#include "raysfm/zoom/map_stretch.h"

#include <algorithm>
#include <functional>
#include <iterator>
#include <vector>

namespace raysfm {
namespace {

constexpr int kLeastSeen = 3;  // key frames that see a point

std::vector<int> points_seen_most(const Reconstruction& r, std::span<const KeyFrame> keyframes, size_t most) {
  std::vector<int> seen(r.points.size(), 0), points;
  for (const KeyFrame& k : keyframes) {
    for (int o = k.first_observation; o < k.last_observation; ++o) ++seen[r.observations[o].point];
  }
  for (size_t i = 0; i < seen.size(); ++i) {
    if (seen[i] >= kLeastSeen) points.push_back(static_cast<int>(i));
  }
  std::ranges::stable_sort(points, std::greater(), [&](int i) { return seen[i]; });
  if (points.size() > most) points.resize(most);
  return points;
}

}  // namespace

MapStretch stretch_of(const Reconstruction& r, const Lens& lens, std::span<const KeyFrame> keyframes,
                      size_t most_points) {
  const Camera& camera = r.rig.cameras[0];
  MapStretch s;
  s.tracks.image_size = {camera.width, camera.height};
  s.tracks.image_count = static_cast<int>(keyframes.size());
  std::vector<int> number(r.points.size(), -1);
  // The last key frame that has seen each point: where tracks were fused, one may see it twice.
  std::vector<int> newest;
  for (const int i : points_seen_most(r, keyframes, most_points)) {
    number[i] = s.tracks.point_count++;
    s.found.scene.points.push_back(r.points[i].position);
    newest.push_back(-1);
  }
  for (int j = 0; j < s.tracks.image_count; ++j) {
    const KeyFrame& k = keyframes[j];
    s.found.scene.cam_from_world.push_back(r.frames[k.frame].world_from_rig->inverse());
    for (int o = k.first_observation; o < k.last_observation; ++o) {
      const int point = number[r.observations[o].point];
      if (point < 0 || newest[point] == j) continue;
      Ray ray;
      if (!camera.ray(r.observations[o].pixel, &ray) || !(ray.direction.z() > 0)) continue;
      newest[point] = j;
      const Eigen::Vector2d ideal = ray.direction.hnormalized();
      s.tracks.add(j, point, {lens.fx * ideal.x() + lens.cx, lens.fy * ideal.y() + lens.cy});
    }
  }
  s.found.scene.lenses.assign(keyframes.size(), lens);
  s.found.image_posed.assign(keyframes.size(), 1);
  s.found.point_placed.assign(s.tracks.point_count, 1);
  s.found.inlier.assign(s.tracks.size(), 1);
  return s;
}

std::vector<std::vector<KeyFrame>> keyframes_by_world(const Reconstruction& r) {
  std::vector<std::vector<KeyFrame>> of_world(r.segments.size());
  for (const KeyFrame& k : r.keyframes) of_world[r.frames[k.frame].segment].push_back(k);
  return of_world;
}

}  // namespace raysfm
