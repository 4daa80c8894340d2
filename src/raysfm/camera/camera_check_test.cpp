#include "raysfm/camera/camera_check.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>

#include "raysfm/camera_files/camera_file.h"
#include "support/shared_data.h"

namespace raysfm {
namespace {

using testing_support::shared_data;

constexpr double kDegrees = 180 / std::numbers::pi;

Camera camera_of(const CameraModel& model, int width = 640, int height = 480) {
  Camera camera;
  camera.name = "c";
  camera.model = model;
  camera.width = width;
  camera.height = height;
  return camera;
}

std::string warnings_of(const Rig& rig) {
  std::string all;
  for (const std::string& warning : camera_warnings(rig)) all += warning + "\n";
  return all;
}

TEST(CameraFacts, PinholeByTrigonometry) {
  const CameraFacts facts = camera_facts(camera_of(Pinhole{400, 400, 319.5, 239.5}));
  EXPECT_NEAR(facts.fov_horizontal_deg, 2 * std::atan(319.5 / 400) * kDegrees, 1e-3);
  EXPECT_NEAR(facts.fov_vertical_deg, 2 * std::atan(239.5 / 400) * kDegrees, 1e-3);
  const double corner = std::atan(std::hypot(319.5, 239.5) / 400) * kDegrees;
  EXPECT_NEAR(facts.fov_diagonal_deg, 2 * corner, 1e-3);
  EXPECT_NEAR(facts.max_angle_deg, corner, 1e-6);
  EXPECT_NEAR(facts.centre_pixels_per_degree, 400 / kDegrees, 1e-3);
  EXPECT_EQ(facts.valid_share, 1);
  EXPECT_LT(facts.round_trip_px, 1e-9);
  EXPECT_TRUE(facts.central);
  EXPECT_FALSE(facts.folds || facts.mirrored);
}

TEST(CameraFacts, APanoramaSweepsTheWholeCircle) {
  const CameraFacts facts = camera_facts(camera_of(Equirectangular::for_image(720, 360), 720, 360));
  EXPECT_NEAR(facts.fov_horizontal_deg, 359.5, 1e-6);  // centre of the first pixel to centre of the last
  EXPECT_NEAR(facts.centre_pixels_per_degree, 2, 1e-3);
}

TEST(CameraFacts, AFisheyeSeesBehindItself) {
  const CameraFacts facts =
      camera_facts(camera_of(KannalaBrandt{168.871771, 168.871771, 279.5, 279.5}, 560, 560));
  EXPECT_NEAR(facts.fov_horizontal_deg, 559 / 168.871771 * kDegrees, 1e-2);
  EXPECT_GT(facts.max_angle_deg, 120);
  // r = f theta: f pixels per radian outwards, f theta / sin(theta) around; their mean is the geometric one.
  const double corner = std::hypot(279.5, 279.5) / 168.871771;
  EXPECT_NEAR(facts.centre_pixels_per_degree, 168.871771 / kDegrees, 1e-3);
  EXPECT_NEAR(facts.max_pixels_per_degree, 168.871771 / kDegrees * std::sqrt(corner / std::sin(corner)),
              1e-2);
}

TEST(CameraFacts, AMirrorIsNonCentralAndMirrored) {
  RAYSFM_SKIP_WITHOUT_SHARED_DATA("rendered");
  const Result<Rig> rig = read_camera_file(shared_data("rendered/mirror/camera.yaml"));
  ASSERT_TRUE(rig) << rig.error().message;
  const CameraFacts facts = camera_facts(rig->cameras[0]);
  EXPECT_FALSE(facts.central);
  EXPECT_TRUE(facts.mirrored);
  EXPECT_FALSE(facts.folds);
  EXPECT_LT(facts.valid_share, 0.9);
  EXPECT_GT(facts.valid_share, 0.5);
}

TEST(CameraWarnings, NothingAboutAGoodCamera) {
  EXPECT_EQ(warnings_of(Rig{{camera_of(Radtan{500, 501, 320, 240, -0.2, 0.05})}}), "");
}

TEST(CameraWarnings, SaysWhatIsSuspicious) {
  const auto says = [](const CameraModel& model, const char* what) {
    const std::string warnings = warnings_of(Rig{{camera_of(model)}});
    EXPECT_NE(warnings.find(what), std::string::npos) << what << " not in: " << warnings;
  };
  says(Pinhole{500, 500, 700, 240}, "outside the image");
  says(Pinhole{500, 500, 500, 240}, "another resolution");
  says(Pinhole{500, 300, 320, 240}, "fx / fy");
  says(Radtan{300, 300, 320, 240, -0.4}, "no ray");
}

TEST(CameraWarnings, RigsThatCannotBe) {
  Camera a = camera_of(Pinhole{500, 500, 320, 240}), b = a;
  b.name = "d";
  b.stream = 1;
  EXPECT_NE(warnings_of(Rig{{a, b}}).find("is its pose missing"), std::string::npos);
  b.rig_from_cam.translation = {110, 0, 0};
  EXPECT_NE(warnings_of(Rig{{a, b}}).find("metres"), std::string::npos);
  b.rig_from_cam.translation = {0.11, 0, 0};
  EXPECT_EQ(warnings_of(Rig{{a, b}}), "");
  b.stream = 0;
  EXPECT_NE(warnings_of(Rig{{a, b}}).find("same images"), std::string::npos);
}

TEST(Placements, SayWhereACameraStands) {
  Camera a = camera_of(Pinhole{500, 500, 320, 240}), b = a;
  b.name = "d";
  a.rig_from_cam.translation = {1, 0, 0};
  b.rig_from_cam.translation = {0.9, 0.2, -0.3};
  b.rig_from_cam.rotation = Eigen::AngleAxisd(-30 / kDegrees, Eigen::Vector3d::UnitY());
  const auto lines = placements(Rig{{a, b}});
  ASSERT_EQ(lines.size(), 1u);
  EXPECT_EQ(lines[0],
            "d stands 0.1 left, 0.2 below, 0.3 behind as c sees it (metres) and looks 30 deg to the left, 0 "
            "deg down");
}

TEST(CompareCameras, OneCameraTurnedAndScaled) {
  const Camera a = camera_of(KannalaBrandt{300, 300, 319.5, 239.5, 0.01});
  const Camera half = camera_of(KannalaBrandt{150, 150, 159.5, 119.5, 0.01}, 320, 240);
  const auto same = compare_cameras(a, half);
  ASSERT_TRUE(same) << same.error().message;
  EXPECT_LT(same->max_px, 1e-6);
  EXPECT_LT(same->rotation_deg, 1e-6);
  EXPECT_FALSE(compare_cameras(a, camera_of(Pinhole{300, 300, 320, 320}, 640, 640)));
}

// A focal length one in a thousand longer moves the rays by a thousandth of their distance from the middle; a
// principal point one pixel to the side is all but a rotation.
TEST(CompareCameras, FindsWhatNoRotationExplains) {
  const Camera a = camera_of(KannalaBrandt{300, 300, 319.5, 239.5});
  const auto longer = compare_cameras(a, camera_of(KannalaBrandt{300.3, 300.3, 319.5, 239.5}));
  ASSERT_TRUE(longer);
  EXPECT_NEAR(longer->max_px, 1e-3 * std::hypot(319.5, 239.5), 0.15);
  EXPECT_GT(longer->max_px, longer->p95_px);
  EXPECT_GT(longer->p95_px, longer->median_px);
  const auto shifted = compare_cameras(a, camera_of(KannalaBrandt{300, 300, 320.5, 239.5}));
  EXPECT_NEAR(shifted->rotation_deg, 1 / 300.0 * kDegrees, 0.05);
  EXPECT_LT(shifted->median_px, 0.3);
}

}  // namespace
}  // namespace raysfm
