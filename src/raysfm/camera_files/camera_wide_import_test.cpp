// Files of cameras beyond perspective ones. Expected rays and pixels are written out from the formats' own
// definitions, or come from OpenCV.

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>
#include <opencv2/calib3d.hpp>
#include <opencv2/core.hpp>

#include "raysfm/camera_files/camera_file.h"
#include "support/camera_texts.h"
#include "support/changed_text.h"
#include "support/temporary_folder.h"

namespace raysfm {
namespace {

using testing_support::with;

using namespace testing_support;

Rig parsed_wide(const std::string& text, std::string* note = nullptr) {
  const Result<Rig> rig = parse_camera_file(text, "file", note);
  EXPECT_TRUE(rig) << rig.error().message;
  return rig ? *rig : Rig{};
}

void expect_refused(const std::string& text, const std::string& part) {
  const Result<Rig> rig = parse_camera_file(text, "file");
  ASSERT_FALSE(rig) << part;
  EXPECT_EQ(rig.error().message.find('\n'), std::string::npos) << rig.error().message;
  EXPECT_NE(rig.error().message.find(part), std::string::npos) << rig.error().message << " lacks " << part;
}

template <typename Model, size_t N>
void expect_parameters(const Camera& camera, const std::array<double, N>& expected) {
  ASSERT_TRUE(std::holds_alternative<Model>(camera.model)) << camera.name;
  const auto numbers = std::get<Model>(camera.model).parameters();
  ASSERT_EQ(numbers.size(), N);
  for (size_t i = 0; i < N; ++i) EXPECT_NEAR(numbers[i], expected[i], 1e-12) << camera.name << " " << i;
}

TEST(KalibrImport, KnowsTheWideModels) {
  std::string note;
  const Rig rig = parsed_wide(kKalibrWideYaml, &note);
  ASSERT_EQ(rig.cameras.size(), 5u);
  expect_parameters<Unified, 9>(rig.cameras[0], {600, 601, 320, 240, 1.1, -0.1, 0.01, 0.001, -0.002});
  expect_parameters<DoubleSphere, 6>(rig.cameras[1], {180, 181, 322, 242, -0.2, 0.57});
  expect_parameters<Eucm, 6>(rig.cameras[2], {230, 231, 323, 243, 0.6, 1.1});
  expect_parameters<KannalaBrandt, 8>(rig.cameras[3], {200, 201, 324, 244, 0.01, -0.02, 0.003, -0.0004});
  EXPECT_NEAR(rig.cameras[4].rig_from_cam.translation.x(), 0.4, 1e-12);
  EXPECT_NE(note.find("FOV"), std::string::npos) << note;
}

// r = f atan(2 tan(theta) tan(omega / 2)) / omega against the fitted camera, over the image.
TEST(KalibrImport, TheFovModelIsFollowedClosely) {
  const Camera camera = parsed_wide(kKalibrWideYaml).cameras[4];
  const double omega = 0.9;
  for (double theta = 0.01; theta < 1.1; theta += 0.05) {
    const double r = 260 * std::atan(2 * std::tan(theta) * std::tan(omega / 2)) / omega;
    if (r > 400) break;
    Eigen::Vector2d pixel;
    ASSERT_TRUE(camera.project({std::sin(theta), 0, std::cos(theta)}, &pixel));
    EXPECT_NEAR(pixel.x(), 319.5 + r, 0.2);
    EXPECT_NEAR(pixel.y(), 239.5, 1e-9);
  }
}

TEST(KalibrImport, RefusesMixturesThatNoModelIs) {
  expect_refused(with(kKalibrWideYaml, "distortion_model: radtan", "distortion_model: equidistant"),
                 "cam0.distortion_model: 'equidistant'");
  expect_refused(with(kKalibrWideYaml, "[-0.2, 0.57,", "[-0.2, 1.57,"), "cam1.intrinsics.alpha: 1.57");
  expect_refused(with(kKalibrWideYaml, "coeffs: [0.9]", "coeffs: [4]"), "omega");
  expect_refused(with(kKalibrWideYaml, "camera_model: ds", "camera_model: dsx"), "cam1.camera_model: 'dsx'");
}

TEST(OpenCvImport, FisheyeProjectsAsOpenCvDoes) {
  const Camera camera = parsed_wide(kOpenCvFisheyeYaml).cameras[0];
  const cv::Matx33d k(200, 0, 320, 0, 201, 240, 0, 0, 1);
  for (const cv::Point3d& point :
       {cv::Point3d(0.3, -0.2, 1), cv::Point3d(2, 1, 0.7), cv::Point3d(-1, 0, 0.2)}) {
    std::vector<cv::Point2d> expected;
    cv::fisheye::projectPoints(std::vector<cv::Point3d>{point}, expected, cv::Vec3d(), cv::Vec3d(), k,
                               cv::Vec4d(0.01, -0.02, 0.003, -0.0004));
    Eigen::Vector2d pixel;
    ASSERT_TRUE(camera.project({point.x, point.y, point.z}, &pixel));
    EXPECT_NEAR(pixel.x(), expected[0].x, 1e-9);
    EXPECT_NEAR(pixel.y(), expected[0].y, 1e-9);
  }
}

TEST(OpenCvImport, OmnidirectionalStereo) {
  const Rig rig = parsed_wide(kOpenCvOmniYaml);
  ASSERT_EQ(rig.cameras.size(), 2u);
  expect_parameters<Unified, 9>(rig.cameras[0], {600, 601, 320, 240, 1.1, -0.1, 0.01, 0.001, -0.002});
  expect_parameters<Unified, 9>(rig.cameras[1], {602, 603, 321, 241, 1.2, -0.1, 0.01, 0, 0});
  // x2 = R x1 + T, a quarter turn about y.
  const Eigen::Vector3d x1(0.3, 0.4, 2), x2(x1.z() + 1, x1.y() + 2, -x1.x() + 3);
  EXPECT_LT((rig.cameras[1].rig_from_cam * x2 - x1).norm(), 1e-9);
}

TEST(OpenCvImport, SaysHowFourCoefficientsWereRead) {
  std::string note;
  parsed_wide(with(kOpenCvFisheyeYaml, "fisheye_model: 1\n", ""), &note);
  EXPECT_NE(note.find("fisheye_model: 1"), std::string::npos) << note;
  parsed_wide(kOpenCvFisheyeYaml, &note);
  EXPECT_EQ(note, "");
}

TEST(BasaltImport, ReadsModelsAndPlaces) {
  const Rig rig = parsed_wide(kBasaltJson);
  ASSERT_EQ(rig.cameras.size(), 3u);
  expect_parameters<DoubleSphere, 6>(rig.cameras[0], {180, 181, 320, 240, -0.2, 0.57});
  expect_parameters<KannalaBrandt, 8>(rig.cameras[1], {200, 201, 322, 242, 0.01, -0.02, 0.003, -0.0004});
  expect_parameters<Eucm, 6>(rig.cameras[2], {230, 231, 323, 243, 0.6, 1});
  // Camera 1 is 0.1 along the IMU's x from camera 0, which is turned about z by the quaternion (0.6, 0.8):
  // cos = 0.28, sin = 0.96; its axes see that as (0.028, -0.096, 0).
  EXPECT_LT((rig.cameras[1].rig_from_cam.translation - Eigen::Vector3d(0.028, -0.096, 0)).norm(), 1e-12);
  expect_refused(with(kBasaltJson, "\"kb4\"", "\"kb9\""), "value0.intrinsics[1].camera_type: 'kb9'");
  expect_refused(with(kBasaltJson, "\"alpha\": 0.57", "\"beta\": 0.57"),
                 "value0.intrinsics[0].intrinsics.alpha");
  expect_refused(with(kBasaltJson, "[640, 480], [640, 480], ", "[640, 480], "), "2 resolutions");
  expect_refused(with(kBasaltJson, "\"qz\": 0.6", "\"qz\": 0.7"), "value0.T_imu_cam[0]");
}

// cam2world of OCamCalib for row and column, turned into the project's axes: its x is down, its y right and
// its z away from the view.
Eigen::Vector3d ocam_ray(double row, double column) {
  const double c = 1.001, d = 0.002, e = -0.003, det = 1 / (c - d * e);
  const double x = det * ((row - 238.5) - d * (column - 322.25));
  const double y = det * (-e * (row - 238.5) + c * (column - 322.25));
  const double r = std::hypot(x, y);
  const double z = -200 + 1e-3 * r * r - 1e-6 * r * r * r + 2e-9 * r * r * r * r;
  return Eigen::Vector3d(y, x, -z).normalized();
}

TEST(OCamImport, RaysAreThoseOfCam2World) {
  for (const std::string& text : {kOCamCalibText, kOmniMvsYaml}) {
    const Camera camera = parsed_wide(text).cameras[0];
    EXPECT_EQ(camera.width, 640);
    EXPECT_EQ(camera.height, 480);
    for (const Eigen::Vector2d& pixel : {Eigen::Vector2d(322.25, 238.5), Eigen::Vector2d(500, 100),
                                         Eigen::Vector2d(20, 30), Eigen::Vector2d(100, 460)}) {
      Ray ray;
      ASSERT_TRUE(camera.ray(pixel, &ray));
      EXPECT_LT((ray.direction - ocam_ray(pixel.y(), pixel.x())).norm(), 1e-12);
    }
  }
  const Rigid3 pose = parsed_wide(kOmniMvsYaml).cameras[0].rig_from_cam;
  EXPECT_LT((pose * Eigen::Vector3d(0, 0, 1) - Eigen::Vector3d(1.1, 0.2, 0.3)).norm(), 1e-9);
}

TEST(OCamImport, NamesWhatIsWrong) {
  expect_refused(with(kOCamCalibText, "480 640", "480"), "width");
  expect_refused(with(kOCamCalibText, "238.5 322.25", "nan 322.25"), "centre: 'nan'");
  expect_refused(with(kOCamCalibText, "-2.0e+02", "2.0e+02"), "polynomial.a0");
  expect_refused(with(kOmniMvsYaml, "[5, -200.0", "[6, -200.0"), "cameras[0].poly");
  expect_refused(with(kOmniMvsYaml, "pose: [0, ", "pose: ["), "cameras[0].pose: 5 numbers");
}

// ImgToWorld of MultiCol-SLAM, x right and y down: u = c x + d y + u0, v = e x + y + v0.
TEST(MultiColImport, RaysAreThoseOfImgToWorld) {
  const Camera camera = parsed_wide(kMultiColYaml).cameras[0];
  const double c = 0.999, d = -0.012, e = 0.0126;
  for (const Eigen::Vector2d& xy :
       {Eigen::Vector2d(0, 0), Eigen::Vector2d(150, -80), Eigen::Vector2d(-250, 190)}) {
    const Eigen::Vector2d pixel(c * xy.x() + d * xy.y() + 322.25, e * xy.x() + xy.y() + 238.5);
    const double r = xy.norm();
    const double z = -200 + 1e-3 * r * r - 1e-6 * r * r * r + 2e-9 * r * r * r * r;
    Ray ray;
    ASSERT_TRUE(camera.ray(pixel, &ray));
    EXPECT_LT((ray.direction - Eigen::Vector3d(xy.x(), xy.y(), -z).normalized()).norm(), 1e-12);
  }
}

TEST(MultiColImport, TheRigNeedsItsCameras) {
  const TemporaryFolder folder;
  std::string rig = "%YAML:1.0\nCameraSystem.nrCams: 1\n";
  for (int i = 1; i <= 6; ++i)
    rig += "CameraSystem.cam1_" + std::to_string(i) + ": " + std::to_string(i) + "\n";
  const auto path = folder.file("MultiCamSys_Calibration.yaml", rig);
  const Result<Rig> missing = read_camera_file(path);
  ASSERT_FALSE(missing);
  EXPECT_NE(missing.error().message.find("InteriorOrientationFisheye0.yaml"), std::string::npos);
  folder.file("InteriorOrientationFisheye0.yaml", kMultiColYaml);
  const Result<Rig> whole = read_camera_file(path);
  ASSERT_TRUE(whole) << whole.error().message;
  // Cayley parameters (1, 2, 3): R = (I - [c]x)^-1 (I + [c]x).
  Eigen::Matrix3d cross;
  cross << 0, -3, 2, 3, 0, -1, -2, 1, 0;
  const Eigen::Matrix3d identity = Eigen::Matrix3d::Identity();
  const Eigen::Matrix3d expected = (identity - cross).inverse() * (identity + cross);
  EXPECT_LT((whole->cameras[0].rig_from_cam.rotation.toRotationMatrix() - expected).norm(), 1e-12);
  EXPECT_EQ(whole->cameras[0].rig_from_cam.translation, Eigen::Vector3d(4, 5, 6));
}

TEST(StellaImport, KnowsItsModels) {
  expect_parameters<KannalaBrandt, 8>(parsed_wide(kStellaYaml).cameras[0],
                                      {441.5, 442.5, 480.25, 275.75, -3.0e-02, -3.3e-03, -2.8e-03, -5.9e-04});
  const Camera panorama = parsed_wide(with(kStellaYaml, "\"fisheye\"", "\"equirectangular\"")).cameras[0];
  Ray ray;
  ASSERT_TRUE(panorama.ray({479.5 + 240, 269.5}, &ray));  // a quarter of the circle to the right
  EXPECT_LT((ray.direction - Eigen::Vector3d::UnitX()).norm(), 1e-9);
  expect_refused(with(kStellaYaml, "\"fisheye\"", "\"other\""), "Camera.model: 'other'");
  expect_refused(with(kStellaYaml, "cols: 960", "cols: 0"), "Camera.cols");
  // Radial division: the ray of radius r is that of r / (1 + k r^2).
  const std::string division =
      with(with(kStellaYaml, "\"fisheye\"", "\"radial_division\""), "k1: -3.0e-02", "distortion: -0.25");
  ASSERT_TRUE(parsed_wide(division).cameras[0].ray({480.25 + 0.6 * 441.5, 275.75}, &ray));
  EXPECT_NEAR(ray.direction.x() / ray.direction.z(), 0.6 / (1 - 0.25 * 0.36), 1e-12);
}

// A pair that stella rectifies: rows of the rectified images are common, so the centres are on the rectified
// x axis, focal_x_baseline / fx apart.
TEST(StellaImport, UndoesTheRectification) {
  const std::string text = R"(Camera:
  {setup: stereo, model: perspective, fx: 400, fy: 400, cx: 320, cy: 240, cols: 640, rows: 480, focal_x_baseline: 44}
StereoRectifier:
  K_left: [500, 0, 321, 0, 501, 241, 0, 0, 1]
  D_left: [0, 0, 0, 0, 0]
  R_left: [0.8, 0, 0.6, 0, 1, 0, -0.6, 0, 0.8]
  K_right: [502, 0, 322, 0, 503, 242, 0, 0, 1]
  D_right: [0, 0, 0, 0, 0]
  R_right: [1, 0, 0, 0, 1, 0, 0, 0, 1]
)";
  const Rig rig = parsed_wide(text);
  ASSERT_EQ(rig.cameras.size(), 2u);
  expect_parameters<Pinhole, 4>(rig.cameras[1], {502, 503, 322, 242});
  // R_left x_left = x_right + (0.11, 0, 0) for R_right = I.
  Eigen::Matrix3d r_left;
  r_left << 0.8, 0, 0.6, 0, 1, 0, -0.6, 0, 0.8;
  const Eigen::Vector3d x_right(0.4, -0.3, 2);
  const Eigen::Vector3d x_left = r_left.transpose() * (x_right + Eigen::Vector3d(0.11, 0, 0));
  EXPECT_LT((rig.cameras[1].rig_from_cam * x_right - x_left).norm(), 1e-12);
}

TEST(OrbSlamImport, ReadsBothCameras) {
  const Rig rig = parsed_wide(kOrbSlamYaml);
  ASSERT_EQ(rig.cameras.size(), 2u);
  expect_parameters<KannalaBrandt, 8>(rig.cameras[1],
                                      {190.44, 190.43, 252.59, 254.91, 0.0034, 0.0017, -0.0026, 0.0003});
  const Eigen::Vector3d x2(1, 2, 3);
  EXPECT_LT((rig.cameras[1].rig_from_cam * x2 - Eigen::Vector3d(1.1, -2.8, 2.3)).norm(), 1e-9);
}

TEST(OrbSlamImport, OldFilesAndRectifiedPairs) {
  const std::string mono =
      "%YAML:1.0\nCamera.fx: 500\nCamera.fy: 501\nCamera.cx: 320\nCamera.cy: 240\nCamera.k1: 0.1\nCamera.k2: "
      "0\n"
      "Camera.p1: 0\nCamera.p2: 0\n";
  const Rig one = parsed_wide(mono);
  expect_parameters<Radtan, 9>(one.cameras[0], {500, 501, 320, 240, 0.1, 0, 0, 0, 0});
  EXPECT_EQ(one.cameras[0].width, 0);
  const Rig pair = parsed_wide(mono + "Camera.bf: 50\n");
  ASSERT_EQ(pair.cameras.size(), 2u);
  EXPECT_NEAR(pair.cameras[1].rig_from_cam.translation.x(), 0.1, 1e-12);
  std::string note;
  EXPECT_EQ(parsed_wide(mono + "Camera.bf: 40\nDepthMapFactor: 5000\n", &note).cameras.size(), 1u);
  EXPECT_NE(note.find("depth"), std::string::npos);
}

// A cubic B-spline reproduces what is linear in its control points: at grid position (gx, gy) the direction
// is (gx - 1.5, gy - 1.5, 2) and the point (gx, 0, 0). Pixels count from corners there.
TEST(GenericImport, RaysOfALinearGrid) {
  const Camera camera = parsed_wide(kGenericYaml).cameras[0];
  for (const Eigen::Vector2d& pixel :
       {Eigen::Vector2d(0, 0), Eigen::Vector2d(39, 29), Eigen::Vector2d(10.25, 20.5)}) {
    const double gx = 1 + (pixel.x() + 0.5) / 40, gy = 1 + (pixel.y() + 0.5) / 30;
    Ray ray;
    ASSERT_TRUE(camera.ray(pixel, &ray));
    EXPECT_LT((ray.direction - Eigen::Vector3d(gx - 1.5, gy - 1.5, 2).normalized()).norm(), 1e-12);
    EXPECT_LT((ray.origin - Eigen::Vector3d(gx, 0, 0)).norm(), 1e-12);
  }
}

TEST(GenericImport, RefusesGridsThatAreNone) {
  expect_refused(with(kGenericYaml, "grid_width : 4", "grid_width : 3"), "grid_width: '3'");
  expect_refused(with(kGenericYaml, "grid_width : 4", "grid_width : 5"), "48 numbers");
  expect_refused(with(kGenericYaml, "grid_width : 4", "grid_width : 30000"), "48 numbers");
  expect_refused(with(kGenericYaml, "-1.5, -1.5, 2,", "-1.5, .nan, 2,"), "direction_grid: '.nan'");
  expect_refused(with(kGenericYaml, "-1.5, -1.5, 2,", "0, 0, 0,"), "direction 0 of length 0");
  expect_refused(with(kGenericYaml, "calibration_max_x : 39", "calibration_max_x : 40"),
                 "calibration_max_x: '40'");
  expect_refused(with(kGenericYaml, "NoncentralGenericModel", "OtherModel"), "type: 'OtherModel'");
}

TEST(ColmapImport, KnowsTheWideModels) {
  const auto one = [](const std::string& line) { return parsed_wide(line).cameras[0]; };
  expect_parameters<KannalaBrandt, 8>(one("1 OPENCV_FISHEYE 640 480 200 201 320 240 1e-2 2e-3 3e-4 4e-5"),
                                      {200, 201, 319.5, 239.5, 1e-2, 2e-3, 3e-4, 4e-5});
  expect_parameters<KannalaBrandt, 8>(one("1 RADIAL_FISHEYE 640 480 200 320 240 1e-2 2e-3"),
                                      {200, 200, 319.5, 239.5, 1e-2, 2e-3, 0, 0});
  expect_parameters<KannalaBrandt, 8>(one("1 SIMPLE_RADIAL_FISHEYE 640 480 200 320 240 1e-2"),
                                      {200, 200, 319.5, 239.5, 1e-2, 0, 0, 0});
  expect_parameters<Eucm, 6>(one("1 EUCM 640 480 200 201 320 240 0.6 1.1"),
                             {200, 201, 319.5, 239.5, 0.6, 1.1});
  const Camera panorama = one("1 EQUIRECTANGULAR 640 320 640 320");
  Eigen::Vector2d pixel;
  ASSERT_TRUE(panorama.project({0, 0, 1}, &pixel));
  EXPECT_LT((pixel - Eigen::Vector2d(319.5, 159.5)).norm(), 1e-9);
  Ray ray;
  ASSERT_TRUE(one("1 SIMPLE_DIVISION 640 480 400 320 240 -0.3").ray({319.5, 239.5 + 200}, &ray));
  EXPECT_NEAR(ray.direction.y() / ray.direction.z(), 0.5 / (1 - 0.3 * 0.25), 1e-12);
  expect_refused("1 DIVISION 640 480 400 401 320 240 0.3", "DIVISION");
  expect_refused("1 THIN_PRISM_FISHEYE 640 480 400 401 320 240 0 0 0.1 0 0 0 0 0", "THIN_PRISM_FISHEYE");
}

TEST(ColmapImport, RigsHaveTheirCamerasBesideThem) {
  const TemporaryFolder folder;
  const std::string line = "7 3 IMU 1 CAMERA 2 1 0.8 0 0 0.6 0.1 0.2 0.3 CAMERA 1 1 1 0 0 0 -0.5 0 0\n";
  const auto rigs = folder.file("rigs.txt", "# RIG_ID, NUM_SENSORS\n" + line);
  const Result<Rig> missing = read_camera_file(rigs);
  ASSERT_FALSE(missing);
  EXPECT_NE(missing.error().message.find("cameras.txt"), std::string::npos) << missing.error().message;
  folder.file("cameras.txt", "1 PINHOLE 640 480 500 501 320 240\n2 SIMPLE_FISHEYE 640 480 200 320 240\n");
  const Result<Rig> rig = read_camera_file(rigs);
  ASSERT_TRUE(rig) << rig.error().message;
  ASSERT_EQ(rig->cameras.size(), 2u);
  EXPECT_EQ(rig->cameras[0].name, "camera2");
  EXPECT_EQ(rig->cameras[1].stream, 1);
  // sensor_from_rig: a turn about z with cos 0.28, sin 0.96, then the shift.
  const Eigen::Vector3d x(1, 2, 3), in_sensor(0.28 * 1 - 0.96 * 2 + 0.1, 0.96 * 1 + 0.28 * 2 + 0.2, 3.3);
  EXPECT_LT((rig->cameras[0].rig_from_cam * in_sensor - x).norm(), 1e-12);
  const auto refused = [&](const std::string& text) {
    const Result<Rig> bad = parse_camera_file(text, rigs);
    EXPECT_FALSE(bad) << text;
    return bad ? "" : bad.error().message;
  };
  EXPECT_NE(refused(with(line, "CAMERA 2", "CAMERA 9")).find("SENSOR_ID: 9"), std::string::npos);
  EXPECT_NE(refused(with(line, " -0.5 0 0", "")).find("cut short"), std::string::npos);
  EXPECT_NE(refused(with(line, "0.8 0 0 0.6", "0.8 0 0 0.7")).find("length"), std::string::npos);
  EXPECT_NE(refused(line + line).find("2 of them"), std::string::npos);
}

}  // namespace
}  // namespace raysfm
