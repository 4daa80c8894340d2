#include <gtest/gtest.h>

#include <opencv2/calib3d.hpp>
#include <opencv2/core.hpp>
#include <opencv2/core/persistence.hpp>

#include "raysfm/camera_files/camera_file.h"
#include "support/camera_texts.h"
#include "support/changed_text.h"
#include "support/temporary_folder.h"

namespace raysfm {
namespace {

using testing_support::with;

using namespace testing_support;

Rig parsed(const std::string& text) {
  const Result<Rig> rig = parse_camera_file(text, "file");
  EXPECT_TRUE(rig) << rig.error().message;
  return rig ? *rig : Rig{};
}

std::string message_of(const std::string& text) {
  const Result<Rig> rig = parse_camera_file(text, "file");
  EXPECT_FALSE(rig);
  return rig ? "" : rig.error().message;
}

void expect_says(const std::string& message, const std::string& part) {
  EXPECT_NE(message.find(part), std::string::npos) << message << " lacks " << part;
}

// x_n = T_n,n-1 ... T_1,0 x_0 written out for a point, against rig_from_cam.
TEST(KalibrImport, ChainsTheCameras) {
  const Rig rig = parsed(kKalibrYaml);
  ASSERT_EQ(rig.cameras.size(), 3u);
  const Eigen::Vector3d x0(0.3, -0.4, 2.0);
  const Eigen::Vector3d x1(x0.x() - 0.11, -x0.z() + 0.01, x0.y() + 0.02);
  const Eigen::Vector3d x2(x1.x() - 0.2, x1.y(), x1.z());
  EXPECT_LT((rig.cameras[1].rig_from_cam * x1 - x0).norm(), 1e-12);
  EXPECT_LT((rig.cameras[2].rig_from_cam * x2 - x0).norm(), 1e-12);
  EXPECT_EQ(rig.cameras[2].stream, 2);
  EXPECT_EQ(rig.cameras[0].width, 752);
  EXPECT_EQ(std::get<Radtan>(rig.cameras[0].model).k1, -0.28);
  EXPECT_EQ(std::get<Pinhole>(rig.cameras[1].model).cy, 255.238);
}

TEST(KalibrImport, PlacesCamerasThroughTheImu) {
  const Rig rig = parsed(kOpenVinsYaml);
  ASSERT_EQ(rig.cameras.size(), 2u);
  // Both turned alike; the second is 0.11 further along the IMU's y, which is the cameras' x.
  EXPECT_LT((rig.cameras[1].rig_from_cam.translation - Eigen::Vector3d(0.11, 0, 0)).norm(), 1e-12);
  EXPECT_EQ(rig.cameras[0].rig_from_cam.translation, Eigen::Vector3d::Zero());
}

TEST(KalibrImport, NamesWhatItCannotRead) {
  expect_says(message_of(with(kKalibrYaml, "camera_model: pinhole", "camera_model: onmi")),
              "cam0.camera_model: 'onmi'");
  expect_says(message_of(with(kKalibrYaml, "distortion_model: radtan", "distortion_model: equidistand")),
              "'equidistand'");
  expect_says(message_of(with(kKalibrYaml, "[-0.28, 0.07,", "[-0.28,")), "cam0.distortion_coeffs");
  expect_says(message_of(with(kKalibrYaml, "[458.654,", "[-458.654,")), "cam0.intrinsics.fx");
  expect_says(
      message_of(with(kKalibrYaml, "resolution: [752, 480]\n  rost", "resolutio: [752, 480]\n  rost")),
      "cam0.resolution");
  expect_says(message_of(with(kKalibrYaml, "T_cn_cnm1", "T_other")), "cam1.T_cn_cnm1: missing");
  expect_says(message_of(with(kKalibrYaml, "[0.0, 0.0, -1.0, 0.01]", "[0.0, 0.0, -1.1, 0.01]")),
              "cam1.T_cn_cnm1");
  expect_says(message_of(with(kKalibrYaml, "[0.0, 0.0, -1.0, 0.01]", "[0.0, 0.0, 1.0, 0.01]")),
              "cam1.T_cn_cnm1");
}

TEST(EurocImport, TheRigIsTheBody) {
  const Rig rig = parsed(kEurocYaml);
  ASSERT_EQ(rig.cameras.size(), 1u);
  EXPECT_LT(
      (rig.cameras[0].rig_from_cam * Eigen::Vector3d(1, 2, 3) - Eigen::Vector3d(-2.02, 0.94, 3.01)).norm(),
      1e-12);
  EXPECT_EQ(std::get<Radtan>(rig.cameras[0].model).parameters(),
            (std::array<double, 9>{458.654, 457.296, 367.215, 248.375, -0.28, 0.07, 0.0002, 0.00002, 0}));
}

// OpenCV writes, the project reads, in all three of OpenCV's syntaxes and with all numbers of coefficients.
TEST(OpenCvImport, ReadsWhatOpenCvWrites) {
  const TemporaryFolder folder;
  const cv::Matx33d k(550.25, 0, 320.5, 0, 560.75, 240.125, 0, 0, 1);
  const std::vector<double> all = {-0.25, 0.1, 1e-3, -2e-3, 0.05, 0.01, 0.02, 0.03};
  for (const char* extension : {"yml", "xml", "json"}) {
    for (const size_t count : {0, 4, 5, 8, 12, 14}) {
      std::vector<double> d(all.begin(), all.begin() + std::min<size_t>(count, 8));
      d.resize(count, 0.0);
      const auto path = folder.path() / (std::string("calibration.") + extension);
      cv::FileStorage file(path.string(), cv::FileStorage::WRITE);
      file << "image_width" << 640 << "image_height" << 480 << "camera_matrix" << cv::Mat(k);
      if (count > 0) file << "distortion_coefficients" << cv::Mat(d);
      file.release();

      const Result<Rig> rig = read_camera_file(path);
      ASSERT_TRUE(rig) << rig.error().message;
      const Camera& camera = rig->cameras.front();
      EXPECT_EQ(camera.width, 640);
      EXPECT_EQ(camera.height, 480);
      const Eigen::Vector3d point(0.3, -0.2, 1.5);
      Eigen::Vector2d pixel;
      ASSERT_TRUE(camera.project(point, &pixel));
      std::vector<cv::Point2d> expected;
      cv::projectPoints(std::vector<cv::Point3d>{{0.3, -0.2, 1.5}}, cv::Vec3d(), cv::Vec3d(), k, d, expected);
      EXPECT_NEAR(pixel.x(), expected[0].x, 1e-9) << extension << " " << count;
      EXPECT_NEAR(pixel.y(), expected[0].y, 1e-9) << extension << " " << count;
    }
  }
}

TEST(OpenCvImport, ReadsAStereoPair) {
  const Rig rig = parsed(kOpenCvXml);
  ASSERT_EQ(rig.cameras.size(), 2u);
  EXPECT_EQ(rig.cameras[1].width, 640);
  EXPECT_EQ(rig.cameras[1].stream, 1);
  EXPECT_EQ(std::get<Rational>(rig.cameras[0].model).k6, 0.31);
  EXPECT_EQ(std::get<Radtan>(rig.cameras[1].model).fx, 551);
  // x2 = R x1 + T
  const Eigen::Vector3d x1(0.3, 0.4, 2), x2(x1.x() - 0.5, -x1.z() + 0.1, x1.y() + 0.2);
  EXPECT_LT((rig.cameras[1].rig_from_cam * x2 - x1).norm(), 1e-12);
}

TEST(OpenCvImport, LeavesOutACameraWithoutAPlaceAndSaysSo) {
  const std::string text = with(with(kOpenCvXml, "<R ", "<R3 "), "</R>", "</R3>");
  std::string note;
  const Result<Rig> rig = parse_camera_file(text, "file", &note);
  ASSERT_TRUE(rig) << rig.error().message;
  EXPECT_EQ(rig->cameras.size(), 1u);
  expect_says(note, "M2");
}

TEST(OpenCvImport, NamesWhatItCannotRead) {
  expect_says(message_of(with(kOpenCvYaml, "image_width: 640", "image_width: 640\nfisheye_model: 1")),
              "distortion_coefficients: 5 numbers");
  expect_says(message_of(with(kOpenCvYaml, "image_width: 640", "image_width: 640\nxi: [1, 2]")), "xi");
  expect_says(message_of(with(kOpenCvYaml, "5.5e+02, 0.,", "5.5e+02, 2.,")), "camera_matrix");
  expect_says(message_of(with(kOpenCvYaml, "5.0e-02", "5.0e-02, 1.")), "distortion_coefficients");
  expect_says(message_of(with(kOpenCvYaml, "5.0e-02", ".Nan")), "distortion_coefficients: '.Nan'");
  expect_says(message_of(with(kOpenCvYaml, "image_height: 480", "")), "image_height: missing");
  expect_says(message_of(with(kOpenCvXml, "</T>", "")), "</opencv_storage>");
  expect_says(message_of(with(kOpenCvXml, "640 480", "640 &bomb; 480")), "entity");
  expect_says(
      message_of(with(kOpenCvXml, "<opencv_storage>", "<!DOCTYPE x [<!ENTITY a 'b'>]><opencv_storage>")),
      "line 2");
}

TEST(KittiImport, TakesTheBaselineOutOfTheProjection) {
  const Rig rig = parsed(kKittiText);
  ASSERT_EQ(rig.cameras.size(), 3u);
  EXPECT_EQ(rig.cameras[0].width, 0);
  EXPECT_LT((rig.cameras[1].rig_from_cam.translation - Eigen::Vector3d(0.5, 0, 0)).norm(), 1e-12);
  // P X by hand for a point of the rig against the camera's own projection.
  const Eigen::Vector3d x(1.5, -0.5, 10);
  const Eigen::Vector3d p(707 * x.x() + 601 * x.z() + 47, 708 * x.y() + 183 * x.z() + 0.12, x.z() + 6.2e-3);
  Eigen::Vector2d pixel;
  ASSERT_TRUE(rig.cameras[2].project(rig.cameras[2].rig_from_cam.inverse() * x, &pixel));
  EXPECT_LT((pixel - p.hnormalized()).norm(), 1e-9);
  EXPECT_EQ(rig.cameras[2].stream, 2);
}

TEST(KittiImport, NamesTheLine) {
  expect_says(message_of(with(kKittiText, "P1: 7.07e+02", "P1: -7.07e+02")), "line 2: P1");
  expect_says(message_of(with(kKittiText, "6.2e-03", "x")), "line 3: P2");
  expect_says(message_of(with(kKittiText, " 6.2e-03", "")), "line 3: P2");
  expect_says(message_of(with(kKittiText, "P1:", "P0:")), "second time");
}

// COLMAP's pixels begin at the corner: its centre of the first pixel, (0.5, 0.5), is the project's (0, 0).
TEST(ColmapImport, ShiftsThePrincipalPoint) {
  const Rig rig = parsed(kColmapText);
  ASSERT_EQ(rig.cameras.size(), 1u);
  EXPECT_EQ(std::get<Radtan>(rig.cameras[0].model).parameters(),
            (std::array<double, 9>{526.2, 527.3, 319.5, 239.5, -0.02, 0.01, 0.001, -0.002, 0}));
  EXPECT_EQ(rig.cameras[0].width, 640);
}

TEST(ColmapImport, KnowsThePerspectiveModels) {
  EXPECT_EQ(std::get<Pinhole>(parsed("1 SIMPLE_PINHOLE 640 480 500 320 240").cameras[0].model).parameters(),
            (std::array<double, 4>{500, 500, 319.5, 239.5}));
  EXPECT_EQ(std::get<Pinhole>(parsed("7 PINHOLE 640 480 500 501 320 240").cameras[0].model).fy, 501);
  const Radtan simple = std::get<Radtan>(parsed("1 SIMPLE_RADIAL 640 480 500 320 240 0.1").cameras[0].model);
  EXPECT_EQ(simple.k1, 0.1);
  EXPECT_EQ(simple.fy, 500);
  EXPECT_EQ(std::get<Radtan>(parsed("1 RADIAL 640 480 500 320 240 0.1 0.2").cameras[0].model).k2, 0.2);
  const Rational full = std::get<Rational>(
      parsed("1 FULL_OPENCV 640 480 500 501 320 240 1 2 .001 .002 3 1.1 2.2 3.3").cameras[0].model);
  EXPECT_EQ(full.p2, .002);
  EXPECT_EQ(full.k3, 3);
  EXPECT_EQ(full.k6, 3.3);
}

TEST(ColmapImport, NamesTheLine) {
  expect_says(message_of("1 OPENCV_FISHEYES 640 480 1 1 320 240 0 0 0 0"), "'OPENCV_FISHEYES'");
  expect_says(message_of("1 PINHOLE 640 480 500 501 320"), "3 numbers");
  expect_says(message_of("1 PINHOLE 640 480 500 501 320 nan"), "'nan'");
  expect_says(message_of("1 PINHOLE 0 480 500 501 320 240"), "WIDTH");
  expect_says(message_of("1 PINHOLE 640 480 0 501 320 240"), "focal lengths 0, 501");
  expect_says(message_of("1 PINHOLE 640 480 1 1 3 2\n2 PINHOLE 640 480 1 1 3 2\n"), "2 of them");
}

}  // namespace
}  // namespace raysfm
