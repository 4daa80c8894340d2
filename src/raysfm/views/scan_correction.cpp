#include "raysfm/views/scan_correction.h"

#include <vector>

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

namespace {

// The point of a feature in the rig's frame at the instant. False where its pixel has no ray.
bool point_of(const TrackingRig& rig, const Map& map, const MapKeyFrame& k, const Eigen::Matrix3d& rotation,
              int f, double usual_distance, const KeyFrameView* view, Eigen::Vector3d* point_in_rig) {
  const Camera& camera = rig.camera(k.cameras[f]);
  Ray ray;
  if (k.tracks[f] >= 0 && map.tracks[k.tracks[f]].triangulated) {
    *point_in_rig = rotation * map.tracks[k.tracks[f]].position + k.rig_from_world.translation;
  } else if (view) {
    *point_in_rig = camera.rig_from_cam * point_on_ray(*view, f, usual_distance);
  } else if (camera.ray(k.pixels[f].cast<double>(), &ray)) {
    *point_in_rig = camera.rig_from_cam * (ray.origin + usual_distance * ray.direction);
  } else {
    return false;
  }
  return true;
}

}  // namespace

void correct_scan(const TrackingRig& rig, const RigMotion& motion, int first, int keyframe, Map* map,
                  KeyFrameView* view) {
  constexpr float kStill = 0.002f;  // pixels
  if (!rig.scans()) return;
  MapKeyFrame& k = map->keyframes[keyframe];
  const double usual_distance = median_distance(k, *map);
  const Eigen::Matrix3d rotation = k.rig_from_world.rotation.toRotationMatrix();
  std::vector<int> features;
  std::vector<Eigen::Vector3d> points_in_rig;
  std::vector<Eigen::Vector2d> pixels;
  std::vector<Eigen::Vector2f> offsets;
  for (int c = 0; c < rig.size(); ++c) {
    features.clear(), points_in_rig.clear(), pixels.clear();
    for (int f = first; f < k.size(); ++f) {
      Eigen::Vector3d point_in_rig;
      if (k.cameras[f] != c || !point_of(rig, *map, k, rotation, f, usual_distance, view, &point_in_rig))
        continue;
      features.push_back(f);
      points_in_rig.push_back(point_in_rig);
      pixels.push_back(k.pixels[f].cast<double>());
    }
    offsets.resize(features.size());
    scan_offsets(rig, c, points_in_rig, motion, pixels, offsets);
    for (size_t i = 0; i < features.size(); ++i) {
      const int f = features[i];
      if ((k.pixels[f] - k.instant_pixel(f) - offsets[i]).squaredNorm() < kStill * kStill) continue;
      set_scan_offset(rig, f, offsets[i], &k);
      if (view) renew_ray(rig, k, f, view);
    }
  }
}

}  // namespace raysfm
