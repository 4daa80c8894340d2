#include "raysfm/zoom/map_stretch.h"

#include <gtest/gtest.h>

#include <cmath>

#include "raysfm/core/random.h"
#include "raysfm/geometry/rotation.h"

namespace raysfm {
namespace {

constexpr int kFilmed = 9, kSeenPoints = 60;
constexpr double kFocal = 400, kInterval = 0.1;
const Lens kLens{kFocal, kFocal, 319.5, 239.5, 0};

// A camera that goes and turns evenly.
Rigid3 cam_from_world(double t) {
  return {Eigen::Quaterniond(exp_so3(Eigen::Vector3d(0.1, 0.4, -0.05) * t)),
          Eigen::Vector3d(-0.5, 0.1, -0.3) * t};
}

// What it sees at the instants of its frames.
Reconstruction seen_by(const RollingShutter& shutter) {
  Rng rng(1);
  Reconstruction r;
  Camera& camera = r.rig.cameras.emplace_back();
  camera.model = Pinhole{kFocal, kFocal, kLens.cx, kLens.cy};
  camera.width = 640, camera.height = 480;
  camera.shutter = shutter;
  r.segments.emplace_back();
  for (int i = 0; i < kSeenPoints; ++i)
    r.points.push_back({{rng.uniform(-2, 2), rng.uniform(-1.5, 1.5), rng.uniform(4, 6)}});
  for (int f = 0; f < kFilmed; ++f) {
    PosedFrame& frame = r.frames.emplace_back();
    frame.timestamp = kInterval * f;
    frame.segment = 0;
    frame.world_from_rig = cam_from_world(frame.timestamp).inverse();
    const int first = static_cast<int>(r.observations.size());
    for (int i = 0; i < kSeenPoints; ++i) {
      Eigen::Vector2d pixel;
      const bool shows = camera.project(cam_from_world(frame.timestamp) * r.points[i].position, &pixel);
      if (shows && camera.contains(pixel)) r.observations.push_back({i, 0, pixel});
    }
    r.keyframes.push_back({f, first, static_cast<int>(r.observations.size())});
  }
  return r;
}

double worst_residual(const MapStretch& s) {
  double worst = 0;
  for (int k = 0; k < s.tracks.size(); ++k)
    worst = std::max(worst, pixel_residual(s.tracks, s.found.scene, {}, k).norm());
  return worst;
}

// The pixels of a map are those of the instant already.
TEST(MapStretch, ARollingShutterIsNotUndoneTwice) {
  const Reconstruction r = seen_by({0.03});
  const MapStretch s = stretch_of(r, kLens, r.keyframes, kSeenPoints);
  ASSERT_GT(s.tracks.size(), 300);
  EXPECT_LT(worst_residual(s), 1e-9);
}

TEST(MapStretch, APointThatAKeyFrameSeesTwiceIsSeenOnce) {
  Reconstruction r = seen_by({});
  const Observation twice = r.observations[0];
  r.observations.insert(r.observations.begin(), {twice.point, 0, twice.pixel + Eigen::Vector2d(1, 0)});
  for (KeyFrame& k : r.keyframes) ++k.first_observation, ++k.last_observation;
  r.keyframes[0].first_observation = 0;
  const MapStretch s = stretch_of(r, kLens, r.keyframes, kSeenPoints);
  EXPECT_TRUE(validate(s.tracks).ok());
}

TEST(MapStretch, OfMorePointsThoseThatMostKeyFramesSee) {
  const Reconstruction r = seen_by({});
  const MapStretch s = stretch_of(r, kLens, r.keyframes, 20);
  EXPECT_EQ(s.tracks.point_count, 20);
  EXPECT_GT(s.tracks.size(), 20 * 7);
}

}  // namespace
}  // namespace raysfm
