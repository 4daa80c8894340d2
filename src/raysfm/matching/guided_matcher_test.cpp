#include "raysfm/matching/guided_matcher.h"

#include <gtest/gtest.h>

#include "support/panel_world.h"

namespace raysfm {
namespace {

Camera test_camera() {
  Camera camera;
  camera.model = Radtan::from_parameters({500, 505, 320, 240, -0.2, 0.05, 0.001, -0.002, 0});
  camera.width = 640;
  camera.height = 480;
  return camera;
}

KeyFrameView one_feature(const TrackingRig& rig, const Eigen::Vector2f& pixel) {
  const ViewPtr view = testing_support::as_view(testing_support::flat_image(640, 480, 128), 0);
  MapKeyFrame keyframe;
  keyframe.add(0, pixel, 0, 0);
  return make_keyframe_view(view, keyframe, rig);
}

// The patch's deformation must be the derivative of the map pixel -> point on the sphere -> other pixel.
TEST(PredictPatch, WarpIsTheDerivativeOfTheTransfer) {
  const TrackingRig rig(Rig{{test_camera()}});
  const Eigen::Vector2f pixel(400, 150);
  const KeyFrameView keyframe = one_feature(rig, pixel);
  const Rigid3 target_from_keyframe{exp_so3({0.02, -0.1, 0.3}), {0.2, -0.1, -0.8}};
  const double distance = 5.0;
  PatchQuery query;
  ASSERT_TRUE(
      predict_patch(rig, keyframe, 0, distance, 0, target_from_keyframe, keyframe.camera_view(0), &query));

  const auto transfer = [&](const Eigen::Vector2d& p) {
    Ray ray;
    EXPECT_TRUE(rig.camera(0).ray(p, &ray));
    Eigen::Vector2d out;
    EXPECT_TRUE(rig.camera(0).project(target_from_keyframe * (distance * ray.direction), &out));
    return out;
  };
  const Eigen::Vector2d center = pixel.cast<double>();
  EXPECT_LT((transfer(center) - query.predicted.cast<double>()).norm(), 1e-3);
  Eigen::Matrix2d numeric;
  for (int c = 0; c < 2; ++c) {
    const Eigen::Vector2d step = 0.01 * Eigen::Vector2d::Unit(c);
    numeric.col(c) = (transfer(center + step) - transfer(center - step)) / 0.02;
  }
  EXPECT_LT((numeric.inverse() - query.keyframe_from_target.cast<double>()).norm(), 1e-3);
}

TEST(PredictPatch, RefusesWhatTheTargetDoesNotSee) {
  const TrackingRig rig(Rig{{test_camera()}});
  const KeyFrameView keyframe = one_feature(rig, {320, 240});
  const auto seen_after = [&](const Rigid3& target_from_keyframe) {
    PatchQuery query;
    return predict_patch(rig, keyframe, 0, 5.0, 0, target_from_keyframe, keyframe.camera_view(0), &query);
  };
  EXPECT_TRUE(seen_after({Eigen::Quaterniond::Identity(), {0, 0, -1}}));
  // Behind, beside, and so near that even in the second octave the patch is more than 2.5 times larger.
  EXPECT_FALSE(seen_after({Eigen::Quaterniond::Identity(), {0, 0, -6}}));
  EXPECT_FALSE(seen_after({exp_so3({0, 1.2, 0}), {0, 0, 0}}));
  EXPECT_TRUE(seen_after({Eigen::Quaterniond::Identity(), {0, 0, -3.5}}));
  EXPECT_FALSE(seen_after({Eigen::Quaterniond::Identity(), {0, 0, -4.1}}));
}

}  // namespace
}  // namespace raysfm
