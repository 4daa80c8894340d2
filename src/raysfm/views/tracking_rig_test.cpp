#include "raysfm/views/tracking_rig.h"

#include <gtest/gtest.h>

#include "support/panel_world.h"

namespace raysfm {
namespace {

using testing_support::small_camera;

Rig stereo(double baseline, double yaw) {
  Rig rig{{small_camera(), small_camera()}};
  rig.cameras[1].rig_from_cam = {exp_so3({0, yaw, 0}), {baseline, 0, 0}};
  return rig;
}

TEST(TrackingRig, CommonViewsAreThoseOfCamerasThatSeeTheSameFromApart) {
  using Pairs = std::vector<std::pair<int, int>>;
  EXPECT_EQ(TrackingRig(stereo(0.4, 0)).common_views(), (Pairs{{0, 1}, {1, 0}}));
  EXPECT_EQ(TrackingRig(stereo(0.4, std::numbers::pi)).common_views(), Pairs{});
  EXPECT_EQ(TrackingRig(stereo(0, 0)).common_views(), Pairs{}) << "no baseline, no depth";
}

TEST(TrackingRig, ResidualsAreAngularWhereAskedOrWhereACameraCannotProject) {
  EXPECT_FALSE(TrackingRig(stereo(0.4, 0)).angular());
  EXPECT_FALSE(TrackingRig(stereo(0.4, 0), ErrorMeasure::kPixel).angular());
  EXPECT_TRUE(TrackingRig(stereo(0.4, 0), ErrorMeasure::kAngular).angular());
  EXPECT_TRUE(TrackingRig(stereo(0.4, 0), ErrorMeasure::kAngularPlain).angular());
  EXPECT_TRUE(validate_error(stereo(0.4, 0), ErrorMeasure::kPixel));
}

TEST(TrackingRig, ScaleMattersWhereRaysHaveSeveralCentres) {
  EXPECT_FALSE(TrackingRig(stereo(0.4, 0)).central());
  EXPECT_TRUE(TrackingRig(Rig{{small_camera()}}).central());
}

// Half a pixel off is a residual of about half, weighted or plain, at the centre of the image.
TEST(TrackingRig, AngularResidualsAreInPixels) {
  for (const ErrorMeasure measure : {ErrorMeasure::kAngular, ErrorMeasure::kAngularPlain}) {
    const TrackingRig rig(stereo(0.4, 0.1), measure);
    const Camera& camera = rig.camera(1);
    Ray seen;
    ASSERT_TRUE(camera.ray({160.5, 119}, &seen));
    ObservedRay ray;
    ASSERT_TRUE(rig.observe(1, {160, 119}, &ray));
    Eigen::Vector2d residual;
    ASSERT_TRUE(ray.residual(camera.rig_from_cam * Eigen::Vector3d(4 * seen.direction), &residual));
    EXPECT_NEAR(residual.norm(), 0.5, 0.01);
  }
}

// Beside, behind and before the camera, of as many points as fill no whole number of blocks.
TEST(TrackingRig, ManyPointsAreSeenAsOneByOne) {
  const Camera pinhole = small_camera();
  Camera distorted = pinhole, fisheye = pinhole, mirror = pinhole;
  distorted.model =
      Radtan{.fx = 200, .fy = 210, .cx = 160, .cy = 120, .k1 = -0.2, .k2 = 0.05, .p1 = 1e-3, .p2 = -2e-3};
  fisheye.model = KannalaBrandt{.fx = 120, .fy = 118, .cx = 160, .cy = 120, .k1 = 0.02, .k2 = -0.01};
  mirror.model = Mirror{.fx = 200, .fy = 200, .cx = 160, .cy = 120};
  Rng rng(3);
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i < 101; ++i) points.emplace_back(3 * rng.normal(), 3 * rng.normal(), 1 + 3 * rng.normal());
  for (const Camera& camera : {pinhole, distorted, fisheye, mirror}) {
    const TrackingRig rig(Rig{{camera}});
    std::vector<PointProjection> many;
    rig.see(0, points, &many);
    ASSERT_EQ(many.size(), points.size());
    int in_image = 0;
    for (size_t i = 0; i < points.size(); ++i) {
      PointProjection one;
      one.in_image = rig.see(0, points[i], &one.pixel, &one.jacobian);
      ASSERT_EQ(many[i].in_image, one.in_image) << model_name(camera.model) << ' ' << i;
      if (!one.in_image) continue;
      ++in_image;
      EXPECT_LT((many[i].pixel - one.pixel).norm(), 1e-9);
      EXPECT_LT((many[i].jacobian - one.jacobian).norm(), 1e-9 * one.jacobian.norm());
    }
    EXPECT_GT(in_image, 5) << model_name(camera.model);
    EXPECT_LT(in_image, 101) << model_name(camera.model);
  }
}

}  // namespace
}  // namespace raysfm
