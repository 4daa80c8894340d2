// What another calibration does to residuals, against what they are where the rig has that calibration.
#include "raysfm/uncertainty/calibration_changes.h"

#include <gtest/gtest.h>

#include "raysfm/geometry/rotation.h"

namespace raysfm {
namespace {

Rig two_cameras() {
  Camera front;
  front.model = KannalaBrandt{300, 310, 320, 240, 0.02, -0.01, 0.002, 0};
  front.width = 640, front.height = 480;
  Camera side = front;
  side.model = Radtan{400, 400, 310, 250, -0.1, 0.02, 0, 0};
  side.rig_from_cam = {exp_so3({0.1, 0.4, -0.2}), Eigen::Vector3d(0.3, 0.1, 0)};
  return {{front, side}};
}

// One number of each kind, in steps that are small beside what they are numbers of.
std::vector<Rig> other_calibrations() {
  std::vector<Rig> others(4, two_cameras());
  std::get<KannalaBrandt>(others[0].cameras[0].model).fx += 0.05;
  std::get<Radtan>(others[1].cameras[1].model).k1 += 1e-4;
  Rigid3& turned = others[2].cameras[1].rig_from_cam;
  turned.rotation = turned.rotation * exp_so3({2e-4, 1e-4, -1e-4});
  others[3].cameras[1].rig_from_cam.translation += Eigen::Vector3d(1e-3, 0, 5e-4);
  return others;
}

Eigen::Vector2d residual(const TrackingRig& rig, int c, const Eigen::Vector2d& pixel,
                         const Eigen::Vector3d& x) {
  Eigen::Vector2d r;
  if (rig.angular()) {
    ObservedRay ray;
    EXPECT_TRUE(rig.observe(c, pixel.cast<float>(), &ray) && ray.residual(x, &r));
    return r;
  }
  EXPECT_TRUE(rig.camera(c).project(rig.cam_from_rig(c) * x, &r));
  return r - pixel;
}

struct CalibrationChangesTest : testing::TestWithParam<ErrorMeasure> {};

TEST_P(CalibrationChangesTest, AreDifferencesOfResiduals) {
  const TrackingRig rig(two_cameras(), GetParam());
  const std::vector<Rig> others = other_calibrations();
  const CalibrationChanges changes(rig, others);
  ASSERT_EQ(changes.size(), 4);
  for (int c = 0; c < 2; ++c) {
    for (const Eigen::Vector2d& pixel : {Eigen::Vector2d(200, 300), {500, 120}}) {
      ObservedRay ray;
      ASSERT_TRUE(rig.observe(c, pixel.cast<float>(), &ray));
      const Eigen::Vector3d x = ray.origin + 4 * ray.direction;
      Eigen::Matrix2Xd found(2, 4);
      ASSERT_TRUE(changes.at(c, pixel, rig.angular() ? &ray : nullptr, x, found));
      for (int k = 0; k < 4; ++k) {
        const TrackingRig other(others[k], GetParam());
        const Eigen::Vector2d expected = residual(other, c, pixel, x) - residual(rig, c, pixel, x);
        EXPECT_LT((found.col(k) - expected).norm(), 0.02 * expected.norm() + 1e-9)
            << "camera " << c << ", " << k << ": " << found.col(k).transpose() << " for "
            << expected.transpose();
        EXPECT_EQ(expected.norm() > 1e-4, (k == 0) == (c == 0)) << c << " " << k;
      }
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Measures, CalibrationChangesTest,
                         testing::Values(ErrorMeasure::kPixel, ErrorMeasure::kAngular));

TEST(CalibrationChanges, WhatAnotherCalibrationDoesNotSeeHasNone) {
  const TrackingRig rig(two_cameras(), ErrorMeasure::kPixel);
  std::vector<Rig> others = {two_cameras()};
  others[0].cameras[1].rig_from_cam.rotation = exp_so3({0, 3, 0});
  const CalibrationChanges changes(rig, others);
  Eigen::Matrix2Xd found(2, 1);
  const Eigen::Vector3d x(0.5, 0.2, 4);
  EXPECT_TRUE(changes.at(0, {320, 240}, nullptr, x, found));
  EXPECT_FALSE(changes.at(1, {320, 240}, nullptr, x, found));
}

}  // namespace
}  // namespace raysfm
