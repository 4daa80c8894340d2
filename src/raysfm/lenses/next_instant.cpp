#include "raysfm/lenses/next_instant.h"

#include <algorithm>
#include <string>
#include <vector>

#include "raysfm/geometry/triangulation.h"

namespace raysfm {
namespace {

Ray sight(const Rigid3& cam_from_world, const Lens& lens, const Eigen::Vector2d& pixel) {
  const double y = (pixel.y() - lens.cy) / lens.fy;
  const double x = (pixel.x() - lens.cx - lens.skew * y) / lens.fx;
  const Rigid3 world_from_cam = cam_from_world.inverse();
  return {world_from_cam.translation, world_from_cam.rotation * Eigen::Vector3d(x, y, 1).normalized()};
}

// Places the new points that can be; the others keep their place at the origin and a mark.
std::vector<uint8_t> place_new_points(const PointTracks& tracks, UncalibratedScene* scene) {
  std::vector<std::vector<Ray>> rays(tracks.point_count);
  for (int k = 0; k < tracks.size(); ++k) {
    const int j = tracks.image[k];
    if (scene->points[tracks.point[k]].allFinite()) continue;
    rays[tracks.point[k]].push_back(sight(scene->cam_from_world[j], scene->lenses[j], tracks.pixel[k]));
  }
  std::vector<uint8_t> unplaced(tracks.point_count, 0);
  for (int i = 0; i < tracks.point_count; ++i) {
    if (scene->points[i].allFinite()) continue;
    Triangulation found;
    unplaced[i] = !triangulate(rays[i], &found);
    scene->points[i] = unplaced[i] ? Eigen::Vector3d::Zero() : found.point;
  }
  return unplaced;
}

}  // namespace

Result<LensAdjustmentSummary> adjust_next_instant(const PointTracks& tracks,
                                                  const LensAdjustmentOptions& options,
                                                  UncalibratedScene* scene) {
  if (auto ok = validate(tracks); !ok) return ok.error();
  if (scene->cam_from_world.size() != static_cast<size_t>(tracks.image_count) ||
      scene->lenses.size() != scene->cam_from_world.size() ||
      scene->points.size() != static_cast<size_t>(tracks.point_count)) {
    return bad_input("scene: " + std::to_string(scene->cam_from_world.size()) + " cameras and " +
                     std::to_string(scene->points.size()) + " points, must be " +
                     std::to_string(tracks.image_count) + " and " + std::to_string(tracks.point_count) +
                     " as in the tracks");
  }
  UncalibratedScene next = *scene;
  const std::vector<uint8_t> unplaced = place_new_points(tracks, &next);
  std::vector<double> weights(tracks.size(), 1.0);
  for (int k = 0; k < tracks.size(); ++k) {
    if (unplaced[tracks.point[k]]) weights[k] = 0;
  }
  auto summary = adjust_polished(tracks, weights, options, &next);
  if (!summary) return summary;
  for (int i = 0; i < tracks.point_count; ++i) {
    if (unplaced[i]) next.points[i] = scene->points[i];
  }
  *scene = std::move(next);
  return summary;
}

}  // namespace raysfm
