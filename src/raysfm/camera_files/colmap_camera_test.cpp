// OpenCV, whose models COLMAP took over, is the judge of the conversion.
#include "raysfm/camera_files/colmap_camera.h"

#include <gtest/gtest.h>

#include <opencv2/calib3d.hpp>

#include "raysfm/core/random.h"

namespace raysfm {
namespace {

// A camera of COLMAP and the same for OpenCV.
struct Case {
  std::string name;
  std::vector<double> parameters;
  double fx, fy, cx, cy;
  std::vector<double> distortion;
  bool fisheye;
};

const Case kCases[] = {
    {"SIMPLE_PINHOLE", {500, 320, 240}, 500, 500, 320, 240, {0, 0, 0, 0}, false},
    {"PINHOLE", {500, 510, 320, 240}, 500, 510, 320, 240, {0, 0, 0, 0}, false},
    {"SIMPLE_RADIAL", {500, 320, 240, -0.1}, 500, 500, 320, 240, {-0.1, 0, 0, 0}, false},
    {"RADIAL", {500, 320, 240, -0.1, 0.02}, 500, 500, 320, 240, {-0.1, 0.02, 0, 0}, false},
    {"OPENCV",
     {500, 510, 320, 240, -0.1, 0.02, 1e-3, -2e-3},
     500,
     510,
     320,
     240,
     {-0.1, 0.02, 1e-3, -2e-3},
     false},
    {"FULL_OPENCV",
     {500, 510, 320, 240, 0.1, 0.02, 1e-3, -2e-3, 0.01, 0.15, 0.03, 0.005},
     500,
     510,
     320,
     240,
     {0.1, 0.02, 1e-3, -2e-3, 0.01, 0.15, 0.03, 0.005},
     false},
    {"OPENCV_FISHEYE",
     {300, 310, 320, 240, 0.02, -0.01, 3e-3, -1e-3},
     300,
     310,
     320,
     240,
     {0.02, -0.01, 3e-3, -1e-3},
     true},
    {"SIMPLE_RADIAL_FISHEYE", {300, 320, 240, 0.02}, 300, 300, 320, 240, {0.02, 0, 0, 0}, true},
    {"RADIAL_FISHEYE", {300, 320, 240, 0.02, -0.01}, 300, 300, 320, 240, {0.02, -0.01, 0, 0}, true},
    {"SIMPLE_FISHEYE", {300, 320, 240}, 300, 300, 320, 240, {0, 0, 0, 0}, true},
    {"FISHEYE", {300, 310, 320, 240}, 300, 310, 320, 240, {0, 0, 0, 0}, true},
};

cv::Point2d project_by_opencv(const Case& c, const Eigen::Vector3d& point) {
  const cv::Matx33d k(c.fx, 0, c.cx, 0, c.fy, c.cy, 0, 0, 1);
  const std::vector<cv::Point3d> points = {{point.x(), point.y(), point.z()}};
  const cv::Vec3d zero(0, 0, 0);
  std::vector<cv::Point2d> pixels;
  if (c.fisheye) {
    cv::fisheye::projectPoints(points, pixels, zero, zero, k, c.distortion);
  } else {
    cv::projectPoints(points, zero, zero, k, c.distortion, pixels);
  }
  return pixels[0];
}

Camera with_model(const CameraModel& model) {
  Camera camera;
  camera.model = model;
  return camera;
}

TEST(ColmapCamera, ProjectsAsOpenCvDoesHalfAPixelAway) {
  Rng random(2);
  for (const Case& c : kCases) {
    const ColmapCameraModel* known = find_colmap_model(c.name);
    ASSERT_NE(known, nullptr) << c.name;
    const Result<CameraModel> model = camera_model_from_colmap(known->id, c.parameters);
    ASSERT_TRUE(model) << model.error().message;
    const Camera camera = with_model(*model);
    for (int i = 0; i < 100; ++i) {
      const Eigen::Vector3d point(random.uniform(-0.6, 0.6), random.uniform(-0.5, 0.5), 1);
      Eigen::Vector2d pixel;
      ASSERT_TRUE(camera.project(3 * point, &pixel)) << c.name;
      const cv::Point2d expected = project_by_opencv(c, 3 * point);
      EXPECT_NEAR(pixel.x() + 0.5, expected.x, 1e-9) << c.name;
      EXPECT_NEAR(pixel.y() + 0.5, expected.y, 1e-9) << c.name;
    }
  }
}

TEST(ColmapCamera, ThereAndBack) {
  for (const Case& c : kCases) {
    const int32_t id = find_colmap_model(c.name)->id;
    const CameraModel model = *camera_model_from_colmap(id, c.parameters);
    const std::optional<ColmapCamera> back = colmap_camera(model);
    ASSERT_TRUE(back) << c.name;
    ASSERT_EQ(find_colmap_model(back->model)->parameters, back->parameters.size());
    const CameraModel again = *camera_model_from_colmap(back->model, back->parameters);
    Eigen::Vector2d a, b;
    const Eigen::Vector3d point(0.3, -0.2, 1);
    ASSERT_TRUE(with_model(model).project(point, &a));
    ASSERT_TRUE(with_model(again).project(point, &b));
    EXPECT_EQ(a, b) << c.name;
  }
}

TEST(ColmapCamera, RefusesWhatIsNoCamera) {
  const auto refusal = [](const char* name, const std::vector<double>& parameters) {
    const Result<CameraModel> model = camera_model_from_colmap(find_colmap_model(name)->id, parameters);
    return model ? "accepted" : model.error().message;
  };
  EXPECT_EQ(refusal("PINHOLE", {0, 500, 320, 240}),
            "PINHOLE with focal lengths 0, 500 is not allowed, finite numbers above 0 are");
  EXPECT_EQ(refusal("SIMPLE_PINHOLE", {-500, 320, 240}),
            "SIMPLE_PINHOLE with focal lengths -500, -500 is not allowed, finite numbers above 0 are");
  EXPECT_EQ(refusal("PINHOLE", {500, 500, 320}), "model 1 with 3 numbers is not allowed");
  EXPECT_EQ(refusal("FOV", {500, 500, 320, 240, 0.9}).substr(0, 27), "FOV has no counterpart here");
  EXPECT_EQ(refusal("THIN_PRISM_FISHEYE", std::vector<double>(12, 1)).substr(0, 18), "THIN_PRISM_FISHEYE");
}

}  // namespace
}  // namespace raysfm
