#include "raysfm/zoom/map_stretch.h"

#include <algorithm>
#include <functional>
#include <iterator>
#include <optional>
#include <vector>

#include "raysfm/geometry/interpolation.h"

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

// How cameras go past a frame: its neighbours in its world.
struct Passing {
  const PosedFrame *before, *at, *after;

  double part(double timestamp) const {
    return (timestamp - before->timestamp) / (after->timestamp - before->timestamp);
  }
  Rigid3 cam_from_world(double timestamp) const {
    return interpolate(before->world_from_rig->inverse(), after->world_from_rig->inverse(), part(timestamp));
  }
};

std::optional<Passing> passing(const Reconstruction& r, int frame) {
  const PosedFrame& at = r.frames[frame];
  const auto neighbour = [&](int f) {
    const bool is_one = f >= 0 && f < std::ssize(r.frames) && r.frames[f].world_from_rig &&
                        r.frames[f].segment == at.segment && !r.frames[f].place_held;
    return is_one ? &r.frames[f] : &at;
  };
  const Passing by{neighbour(frame - 1), &at, neighbour(frame + 1)};
  if (!(by.after->timestamp > by.before->timestamp)) return std::nullopt;
  return by;
}

// By how much a rolling shutter shows a point beside where it would be, had the image been exposed at once.
Eigen::Vector2d scan_offset(const Camera& camera, const Passing& by, const Eigen::Vector3d& point,
                            const Eigen::Vector2d& pixel) {
  const double then = by.at->timestamp + camera.exposed_after(pixel);
  Eigen::Vector2d seen, at_once;
  const bool shows = camera.project(by.cam_from_world(then) * point, &seen) &&
                     camera.project(by.cam_from_world(by.at->timestamp) * point, &at_once);
  return shows ? Eigen::Vector2d(seen - at_once) : Eigen::Vector2d::Zero();
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
    const std::optional<Passing> by =
        camera.shutter.readout > 0 ? passing(r, k.frame) : std::optional<Passing>();
    for (int o = k.first_observation; o < k.last_observation; ++o) {
      const int point = number[r.observations[o].point];
      if (point < 0 || newest[point] == j) continue;
      Eigen::Vector2d pixel = r.observations[o].pixel;
      if (by) pixel -= scan_offset(camera, *by, s.found.scene.points[point], pixel);
      Ray ray;
      if (!camera.ray(pixel, &ray) || !(ray.direction.z() > 0)) continue;
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
