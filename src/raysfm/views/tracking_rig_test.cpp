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

}  // namespace
}  // namespace raysfm
