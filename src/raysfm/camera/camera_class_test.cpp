#include "raysfm/camera/camera_class.h"

#include <gtest/gtest.h>

#include "support/model_fixtures.h"

namespace raysfm {
namespace {

using testing_support::fixture_camera;
using testing_support::fixtures;

Rig rig_at(const std::vector<Eigen::Vector3d>& centres) {
  Rig rig;
  for (const Eigen::Vector3d& centre : centres) {
    rig.cameras.push_back(fixture_camera(fixtures<Radtan>()[0]));
    rig.cameras.back().rig_from_cam.translation = centre;
    rig.cameras.back().rig_from_cam.rotation =
        Eigen::AngleAxisd(centre.x(), Eigen::Vector3d(1, 2, 3).normalized());
  }
  return rig;
}

TEST(CameraClass, CentresDecide) {
  EXPECT_EQ(camera_class({}), CameraClass::kCentral);
  EXPECT_EQ(camera_class(rig_at({{0.4, 0.1, 2}})), CameraClass::kCentral);
  // Cameras that turn about one point.
  EXPECT_EQ(camera_class(rig_at({{1, 2, 3}, {1, 2, 3}})), CameraClass::kCentral);
  EXPECT_EQ(camera_class(rig_at({{0, 0, 0}, {0.5, 0, 0}})), CameraClass::kAxial);
  EXPECT_EQ(camera_class(rig_at({{1, 1, 1}, {1.5, 1.25, 0}, {0, 0.5, 3}})), CameraClass::kAxial);
  EXPECT_EQ(camera_class(rig_at({{0, 0, 0}, {0.5, 0, 0}, {0.25, 0.01, 0}})), CameraClass::kNonAxial);
}

TEST(CameraClass, AMirrorIsNonCentral) {
  for (const Mirror& mirror : fixtures<Mirror>()) {
    Rig rig;
    rig.cameras.push_back(fixture_camera(mirror));
    EXPECT_EQ(camera_class(rig), CameraClass::kNonCentral);
    rig.cameras.push_back(fixture_camera(fixtures<Pinhole>()[0]));
    EXPECT_EQ(camera_class(rig), CameraClass::kNonCentral);
  }
}

// A hyperboloid with the camera in its far focus: the rays start on the mirror, all through the near focus.
TEST(CameraClass, AHyperboloidSeenFromItsFocusIsCentral) {
  const double conic = -2.4, radius = 0.1;
  const double a = radius / (-1 - conic), c = std::sqrt(a * a + radius * radius / (-1 - conic));
  Rig rig;
  Mirror mirror = fixtures<Mirror>()[2];
  auto numbers = mirror.parameters();
  numbers[4] = radius, numbers[5] = conic, numbers[7] = numbers[8] = 0, numbers[9] = a + c;
  numbers[10] = numbers[11] = numbers[12] = 0, numbers[13] = 1;
  numbers[0] = numbers[1] = 500;
  rig.cameras.push_back(fixture_camera(Mirror::from_parameters(numbers)));
  EXPECT_EQ(camera_class(rig), CameraClass::kCentral);
}

TEST(CameraClass, HasTheNamesOfTheReport) {
  EXPECT_EQ(to_string(CameraClass::kCentral), "central");
  EXPECT_EQ(to_string(CameraClass::kAxial), "axial");
  EXPECT_EQ(to_string(CameraClass::kNonAxial), "non-axial");
  EXPECT_EQ(to_string(CameraClass::kNonCentral), "non-central");
}

}  // namespace
}  // namespace raysfm
