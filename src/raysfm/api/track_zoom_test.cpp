#include "raysfm/api/track_zoom.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "raysfm/core/random.h"
#include "raysfm/geometry/rotation.h"
#include "raysfm/scene/frame_lens.h"
#include "raysfm/uncalibrated/video_reconstruct.h"

namespace raysfm {
namespace {

constexpr int kImages = 60, kPoints = 900;

// A camera walks past points; its focal length grows by `zoom` from one of its images to another.
PointTracks make_tracks(double zoom, int begin, int end) {
  Rng rng(3);
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i < kPoints; ++i) {
    points.emplace_back(rng.uniform(-10, 40), rng.uniform(-5, 5), rng.uniform(6, 14));
  }
  PointTracks tracks{.image_count = kImages,
                     .point_count = kPoints,
                     .image_size = {640, 480},
                     .image = {},
                     .point = {},
                     .pixel = {}};
  for (int j = 0; j < kImages; ++j) {
    const double s = double(j) / (kImages - 1);
    const double focal = 500 * std::pow(zoom, std::clamp(double(j - begin) / (end - begin), 0.0, 1.0));
    const Eigen::Vector3d turn(0.15 * std::sin(9 * s), 0.25 * std::sin(7 * s), 0.2 * std::sin(11 * s));
    const Eigen::Vector3d centre(30 * s, 0.8 * std::sin(8 * s), 1.5 * std::sin(10 * s));
    for (int i = 0; i < kPoints; ++i) {
      const Eigen::Vector3d x = exp_so3(turn) * (points[i] - centre);
      if (!(x.z() > 1)) continue;
      const Eigen::Vector2d noise(rng.normal(), rng.normal());
      const Eigen::Vector2d p = focal * x.hnormalized() + Eigen::Vector2d(319.5, 239.5) + 0.2 * noise;
      if (p.x() > 0 && p.y() > 0 && p.x() < 639 && p.y() < 479) tracks.add(j, i, p);
    }
  }
  return tracks;
}

// Such a walk as a map of one lens has it: poses and points are bent to fit.
Reconstruction make_map(double zoom, int begin, int end) {
  const PointTracks tracks = make_tracks(zoom, begin, end);
  const std::vector<uint8_t> all(kImages, 1);
  const auto found =
      reconstruct_video(tracks, all, {.lens = LensChange::kFixed, .radial = RadialChoice::kNone});
  if (!found) return {};
  Reconstruction r;
  const int posed = found->first_posed();
  r.rig.cameras.push_back(frame_lens(found->scene.lenses[posed], {}).camera);
  r.rig.cameras[0].width = 640, r.rig.cameras[0].height = 480;
  r.segments.push_back({0, kImages - 1, "end of input", false, {}});
  for (const Eigen::Vector3d& point : found->scene.points) r.points.push_back({point});
  for (int j = 0; j < kImages; ++j) {
    PosedFrame& frame = r.frames.emplace_back();
    if (!found->image_posed[j]) continue;
    frame.segment = 0;
    frame.world_from_rig = found->scene.cam_from_world[j].inverse();
    const int first = static_cast<int>(r.observations.size());
    for (int k = 0; k < tracks.size(); ++k) {
      if (tracks.image[k] == j && found->inlier[k])
        r.observations.push_back({tracks.point[k], 0, tracks.pixel[k]});
    }
    r.keyframes.push_back({j, first, static_cast<int>(r.observations.size())});
  }
  return r;
}

TEST(TrackZoom, AMapTellsWhereTheCameraZoomed) {
  const Reconstruction still = make_map(1, 0, 1);
  ASSERT_EQ(still.keyframes.size(), size_t{kImages});
  EXPECT_FALSE(zoom_in_map(still));
  const Reconstruction zoomed = make_map(1.1, 46, 54);
  ASSERT_GT(zoomed.keyframes.size(), 50u);
  const std::optional<ZoomedStretch> late = zoom_in_map(zoomed);
  ASSERT_TRUE(late);
  EXPECT_GT(late->last_frame, 46);
  EXPECT_EQ(late->keyframes, zoomed.keyframes.size());
}

TEST(TrackZoom, NothingIsSaidOfLensesThatAreNotPerspective) {
  Reconstruction r = make_map(1.1, 46, 54);
  r.rig.cameras[0].model = KannalaBrandt{};
  EXPECT_FALSE(zoom_in_map(r));
}

TEST(TrackZoom, SavedMapsAndManyKeyFramesAreNotSolved) {
  TrackSettings settings;
  settings.inputs = {"video.mp4"};
  EXPECT_TRUE(can_be_solved(settings, 50));
  EXPECT_FALSE(can_be_solved(settings, 5000));
  EXPECT_FALSE(can_be_solved(settings, INFINITY));
  settings.save_map = "map.db";
  EXPECT_FALSE(can_be_solved(settings, 50));
}

}  // namespace
}  // namespace raysfm
