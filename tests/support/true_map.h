#pragma once

#include "support/panel_world.h"

namespace raysfm::testing_support {

// A map whose poses and points are the truth, with what matching needs of its key frames.
struct TrueMap {
  TrackingRig rig;
  Map map;
  std::vector<KeyFrameView> views;
};

// Rig that carries its camera off centre and turned, so that mistaking one for the other shows.
inline TrackingRig crooked_rig(int k = 1) {
  Rig rig{{small_camera(k)}};
  rig.cameras[0].rig_from_cam = {exp_so3({0.05, -0.1, 0.2}), {0.1, -0.2, 0.05}};
  return TrackingRig(std::move(rig));
}

// Rig poses at steps of 0.15 m to the right, looking about ahead; the camera sees all three panels.
inline Rigid3 true_pose(const TrackingRig& rig, double step) {
  const Rigid3 world_from_cam{exp_so3({0.01 * step, -0.012 * step, 0.008 * step}),
                              {-0.3 + 0.15 * step, 0.02 * step, 0.01 * step}};
  return rig.camera(0).rig_from_cam * world_from_cam.inverse();
}

// Points at the corners of the first key frame, seen by the key frames wherever nothing hides them. Every
// pixel is an exact projection. With `every` = n only each n-th corner has a track; pictures
// may be enlarged.
inline TrueMap true_map(const PanelWorld& world, int keyframes, int every = 1, int enlargement = 1) {
  TrueMap out{crooked_rig(enlargement), {}, {}};
  const Camera& camera = out.rig.camera(0);
  std::vector<ViewPtr> views;
  for (int k = 0; k < keyframes; ++k) {
    MapKeyFrame& keyframe = out.map.keyframes.emplace_back();
    keyframe.frame = k;
    keyframe.rig_from_world = true_pose(out.rig, k);
    views.push_back(film_enlarged(world, camera.rig_from_cam, keyframe.rig_from_world, k, enlargement));
  }
  const Features& features = views[0]->cameras[0].features;
  for (int f = 0; f < features.size(); f += every) {
    const Eigen::Vector2d corner = features.pixels[f].cast<double>();
    const auto point = world.hit(world_ray(camera, out.map.keyframes[0].rig_from_world, corner));
    if (!point) continue;
    const int track = static_cast<int>(out.map.tracks.size());
    out.map.tracks.push_back({*point, true, {}, {}});
    for (int k = 0; k < keyframes; ++k) {
      MapKeyFrame& keyframe = out.map.keyframes[k];
      Eigen::Vector2d pixel;
      const Rigid3 cam_from_world = camera.rig_from_cam.inverse() * keyframe.rig_from_world;
      if (!camera.project(cam_from_world * *point, &pixel) || !camera.contains(pixel)) continue;
      const auto seen = world.hit(world_ray(camera, keyframe.rig_from_world, pixel));
      if (!seen || (*seen - *point).norm() > 1e-3) continue;
      out.map.observe(track, k, keyframe.add(0, pixel.cast<float>(), features.octaves[f], track));
    }
  }
  for (int k = 0; k < keyframes; ++k) {
    out.views.push_back(make_keyframe_view(views[k], out.map.keyframes[k], out.rig));
  }
  return out;
}

}  // namespace raysfm::testing_support
