#include "raysfm/colmap_bal/model_reconstruction.h"

#include <gtest/gtest.h>

#include "raysfm/colmap_bal/colmap_file.h"
#include "raysfm/geometry/rotation.h"
#include "support/small_reconstruction.h"
#include "support/temporary_folder.h"

namespace raysfm {
namespace {

// Two cameras and three points of which the second sees all, in an order that is not that of the cameras.
const BalFile kBal{
    .cameras = {{0.1, -0.2, 0.3, 0.5, -0.4, 0.2, 400, -0.05, 0.01},
                {-0.3, 0.1, 0.2, 0.1, 0.2, -0.3, 410, 0.02, -0.03}},
    .points = {{0.2, 0.1, -5}, {-1, 0.5, -6}, {0.7, -0.9, -7}},
    .observations = {{1, 2, {0, 0}}, {0, 0, {0, 0}}, {1, 0, {0, 0}}, {0, 2, {0, 0}}, {1, 1, {0, 0}}},
    .compressed = false};

// As the format defines it: from the centre of the image, y up.
Eigen::Vector2d bal_pixel(const std::array<double, 9>& c, const Eigen::Vector3d& point) {
  const Eigen::Vector3d p = exp_so3({c[0], c[1], c[2]}) * point + Eigen::Vector3d(c[3], c[4], c[5]);
  const Eigen::Vector2d n = -p.head<2>() / p.z();
  const double q = n.squaredNorm();
  return c[6] * (1 + c[7] * q + c[8] * q * q) * n;
}

TEST(ModelReconstruction, BalCamerasSeeTheirPointsWhereTheFormatSays) {
  BalFile file = kBal;
  for (BalObservation& o : file.observations)
    o.pixel = bal_pixel(file.cameras[o.camera], file.points[o.point]);
  const Reconstruction r = reconstruction_of(file);
  EXPECT_EQ(r.origin, Origin::kAdjust);
  ASSERT_EQ(r.keyframes.size(), 2u);
  std::vector<int> points;
  for (const KeyFrame& keyframe : r.keyframes) {
    const PosedFrame& frame = r.frames[keyframe.frame];
    for (int i = keyframe.first_observation; i < keyframe.last_observation; ++i) {
      const Observation& o = r.observations[i];
      points.push_back(o.point);
      Eigen::Vector2d pixel;
      ASSERT_TRUE(camera_of(r, frame, o.camera)
                      .project(frame.world_from_rig->inverse() * r.points[o.point].position, &pixel));
      EXPECT_LT((pixel - o.pixel).norm(), 1e-9);
    }
  }
  EXPECT_EQ(points, (std::vector{0, 2, 2, 0, 1}));
}

TEST(ModelReconstruction, AColmapModelIsWhatItWasWrittenFrom) {
  const testing_support::TemporaryFolder folder;
  const Reconstruction from = testing_support::small_reconstruction({Pinhole{500, 510, 319.5, 239.5}});
  ASSERT_TRUE(write_colmap_model(from, folder.path()).ok());
  Result<ColmapModel> model = read_colmap_model(folder.path());
  ASSERT_TRUE(model.ok()) << model.error().message;
  // The last image has a camera that has no counterpart here, and a keypoint of no point.
  model->cameras.push_back({.id = 2, .model = find_colmap_model("FOV")->id, .parameters = {1, 1, 1, 1, 1}});
  model->images[3].camera = 1;
  model->images[3].last_keypoint = model->images[3].first_keypoint + 1;
  model->keypoints[model->images[3].first_keypoint].point_id = kNoColmapPoint;

  const Reconstruction r = reconstruction_of(*model);
  ASSERT_EQ(r.frames.size(), 4u);
  ASSERT_EQ(r.lenses.size(), 1u);
  EXPECT_EQ(r.lenses[0].camera.width, 640);
  EXPECT_EQ(r.lenses[0].camera.height, 480);
  for (int k = 0; k < 4; ++k) {
    const PosedFrame& a = r.frames[k];
    const PosedFrame& b = from.frames[3 * k];
    EXPECT_EQ(a.lens, k < 3 ? 0 : -1);
    EXPECT_EQ(a.image_name, b.image_name);
    EXPECT_LT((a.world_from_rig->translation - b.world_from_rig->translation).norm(), 1e-14);
    EXPECT_LT(a.world_from_rig->rotation.angularDistance(b.world_from_rig->rotation), 1e-14);
  }
  const auto observations = static_cast<size_t>(from.keyframes[3].first_observation);
  ASSERT_EQ(r.observations.size(), observations);
  for (size_t i = 0; i < observations; ++i) {
    EXPECT_EQ(r.points[r.observations[i].point].position, from.points[from.observations[i].point].position);
    EXPECT_EQ(r.points[r.observations[i].point].rgb, from.points[from.observations[i].point].rgb);
    EXPECT_LT((r.observations[i].pixel - from.observations[i].pixel).norm(), 1e-12);
  }
}

}  // namespace
}  // namespace raysfm
