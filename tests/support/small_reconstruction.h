#pragma once

#include <limits>
#include <string>

#include "raysfm/core/random.h"
#include "raysfm/scene/reconstruction.h"

namespace raysfm::testing_support {

// Twelve frames of a rig that drives along x past random points, every third one a key frame, frame 5 without
// a pose. Observations are exact projections, so that a reader that understands the files finds no
// reprojection error.
inline Reconstruction small_reconstruction(const std::vector<CameraModel>& models) {
  Reconstruction r;
  for (size_t c = 0; c < models.size(); ++c) {
    Camera camera;
    camera.name = "cam" + std::to_string(c);
    camera.model = models[c];
    camera.width = 640;
    camera.height = 480;
    camera.rig_from_cam = {exp_so3({0, 0.2 * static_cast<double>(c), 0}),
                           {0.3 * static_cast<double>(c), 0, 0}};
    r.rig.cameras.push_back(camera);
  }
  Rng rng(11);
  for (int i = 0; i < 200; ++i) {
    MapPoint point;
    point.position = {rng.uniform(-4, 8), rng.uniform(-3, 3), rng.uniform(4, 12)};
    for (uint8_t& channel : point.rgb) channel = static_cast<uint8_t>(rng.index(256));
    r.points.push_back(point);
  }
  for (int i = 0; i < 12; ++i) {
    PosedFrame frame;
    frame.timestamp = 100 + 0.1 * i;
    frame.image_name = "image_" + std::to_string(i) + ".png";
    if (i == 5) {
      frame.reason = "too few matches: 3";
    } else {
      frame.segment = 0;
      frame.world_from_rig =
          Rigid3{exp_so3({0.01 * i, -0.02 * i, 0.005 * i}), {0.3 * i, 0.01 * i, -0.02 * i}};
      for (int row = 0; row < 6; ++row) {
        for (int column = 0; column < 6; ++column) {
          frame.covariance(row, column) = (10 * std::min(row, column) + std::max(row, column)) / 1e6;
        }
      }
    }
    r.frames.push_back(frame);
  }
  for (int i = 0; i < 12; i += 3) {
    KeyFrame keyframe{i, static_cast<int>(r.observations.size()), 0};
    for (int c = 0; c < static_cast<int>(r.rig.cameras.size()); ++c) {
      const Camera& camera = r.rig.cameras[c];
      const Rigid3 cam_from_world = (*r.frames[i].world_from_rig * camera.rig_from_cam).inverse();
      for (int p = 0; p < static_cast<int>(r.points.size()); ++p) {
        Eigen::Vector2d pixel;
        if (!camera.project(cam_from_world * r.points[p].position, &pixel) || !camera.contains(pixel))
          continue;
        r.observations.push_back({p, c, pixel});
      }
    }
    keyframe.last_observation = static_cast<int>(r.observations.size());
    r.keyframes.push_back(keyframe);
  }
  r.segments.push_back({0, 11, "end of input", false, {}});
  r.starts.push_back({"five-point", {0, 3, 6}, 87});
  r.rms_reprojection_px = 0.25;
  return r;
}

// The same frames and points as `solve` would give them: a lens for each frame where it zooms, else one, with
// numbers that no fixed count of digits holds.
inline Reconstruction small_solved_reconstruction(bool zooming, const RadialDistortion& radial) {
  Reconstruction r = small_reconstruction({Pinhole{500, 500, 319.5, 239.5}});
  r.origin = Origin::kSolve;
  r.rig = {};
  for (PosedFrame& frame : r.frames) {
    if (!frame.world_from_rig) continue;
    if (zooming || r.lenses.empty()) {
      const double change = static_cast<double>(r.lenses.size()) / 3;
      FrameLens& lens = r.lenses.emplace_back(
          frame_lens({500 + change, 500 + change, 319 + change, 239 + change / 7, change / 11}, radial));
      lens.camera.width = 640;
      lens.camera.height = 480;
      lens.sigma << 1.0 / 3, 1.0 / 3, 0.1, 0.7 + change, std::numeric_limits<double>::infinity();
      lens.radial_sigma = radial.none() ? RadialDistortion{} : RadialDistortion{1.0 / 7, 0.1};
    }
    frame.lens = static_cast<int>(r.lenses.size()) - 1;
  }
  return r;
}

}  // namespace raysfm::testing_support
