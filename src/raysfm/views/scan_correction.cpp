#include "raysfm/views/scan_correction.h"

#include "raysfm/scene/map_measures.h"

namespace raysfm {

void set_scan_offset(const TrackingRig& rig, int feature, const Eigen::Vector2f& offset,
                     MapKeyFrame* keyframe) {
  keyframe->scan_offsets.resize(keyframe->size(), Eigen::Vector2f::Zero());
  keyframe->scan_offsets[feature] = offset;
  ObservedRay ray;
  if (rig.angular() && rig.observe(keyframe->cameras[feature], keyframe->instant_pixel(feature), &ray)) {
    keyframe->rays[feature] = ray;
  }
}

void correct_scan(const TrackingRig& rig, const Velocity& velocity, int first, int keyframe, Map* map,
                  KeyFrameView* view) {
  constexpr float kStill = 0.002f;  // pixels
  if (!rig.scans()) return;
  MapKeyFrame& k = map->keyframes[keyframe];
  const double usual_distance = median_distance(k, *map);
  for (int f = first; f < k.size(); ++f) {
    const int camera = k.cameras[f];
    const Eigen::Vector2d pixel = k.pixels[f].cast<double>();
    Eigen::Vector3d point_in_rig;
    if (k.tracks[f] >= 0 && map->tracks[k.tracks[f]].triangulated) {
      point_in_rig = k.rig_from_world * map->tracks[k.tracks[f]].position;
    } else if (Ray ray; view) {
      point_in_rig = rig.camera(camera).rig_from_cam * point_on_ray(*view, f, usual_distance);
    } else if (rig.camera(camera).ray(pixel, &ray)) {
      point_in_rig = rig.camera(camera).rig_from_cam * (ray.origin + usual_distance * ray.direction);
    } else {
      continue;
    }
    const Eigen::Vector2f offset = scan_offset(rig, camera, point_in_rig, velocity, pixel);
    if ((k.pixels[f] - k.instant_pixel(f) - offset).squaredNorm() < kStill * kStill) continue;
    set_scan_offset(rig, f, offset, &k);
    if (view) renew_ray(rig, k, f, view);
  }
}

}  // namespace raysfm
