#include "raysfm/camera/camera.h"

#include <gtest/gtest.h>

#include <cmath>

namespace raysfm {
namespace {

Camera make_camera(CameraModel model) {
  Camera camera;
  camera.model = std::move(model);
  camera.width = 640;
  camera.height = 480;
  return camera;
}

TEST(Camera, RayAndProjectAreThoseOfTheModel) {
  const Camera camera = make_camera(Radtan{458.654, 457.296, 367.215, 248.375, -0.28340811, 0.07395907});
  Ray ray;
  ray.origin.setOnes();
  ASSERT_TRUE(camera.ray({100, 50}, &ray));
  EXPECT_EQ(ray.origin, Eigen::Vector3d::Zero());
  EXPECT_NEAR(ray.direction.norm(), 1, 1e-14);
  Eigen::Vector2d pixel;
  Eigen::Matrix<double, 2, 3> jacobian;
  ASSERT_TRUE(camera.project(5 * ray.direction, &pixel, &jacobian));
  EXPECT_LT((pixel - Eigen::Vector2d(100, 50)).norm(), 1e-10);
  // Along the ray nothing moves.
  EXPECT_LT((jacobian * ray.direction).norm(), 1e-9);
  EXPECT_FALSE(camera.project({0, 0, -1}, &pixel));
}

TEST(Camera, ContainsThePixelsWithTheirBorders) {
  const Camera camera = make_camera(Pinhole{});
  EXPECT_TRUE(camera.contains({-0.5, -0.5}));
  EXPECT_TRUE(camera.contains({639.4, 479.4}));
  EXPECT_FALSE(camera.contains({639.5, 0}));
  EXPECT_FALSE(camera.contains({0, -0.6}));
}

// A pinhole's image plane is at right angles to the axis, where a pixel is an angle of 1 / f.
TEST(Camera, PixelsPerRadianIsTheFocalLengthOnTheAxis) {
  EXPECT_NEAR(make_camera(Pinhole{500, 500, 319.5, 239.5}).pixels_per_radian(), 500, 1e-3);
  EXPECT_NEAR(make_camera(Pinhole{400, 900, 319.5, 239.5}).pixels_per_radian(), 600, 1e-2);
}

TEST(Camera, PixelsPerRadianLooksBesideABlindCentre) {
  // Its rays reach 0.61 of the focal length, 61 pixels, around the principal point (100, 100) only.
  const Camera camera = make_camera(Radtan{100, 100, 100, 100, -0.4});
  Ray ray;
  ASSERT_FALSE(camera.ray({319.5, 239.5}, &ray));
  EXPECT_GT(camera.pixels_per_radian(), 20);
  // And beside the image nothing is seen at all.
  EXPECT_EQ(make_camera(Radtan{100, 100, -1000, 100, -0.4}).pixels_per_radian(), 0);
}

TEST(Camera, ModelsHaveTheNamesOfTheCameraFile) {
  EXPECT_EQ(model_name(Pinhole{}), "pinhole");
  EXPECT_EQ(model_name(Radtan{}), "radtan");
  EXPECT_EQ(model_name(Rational{}), "rational");
  EXPECT_EQ(model_name(KannalaBrandt{}), "kannala-brandt");
  EXPECT_EQ(model_name(Unified{}), "unified");
  EXPECT_EQ(model_name(DoubleSphere{}), "double-sphere");
  EXPECT_EQ(model_name(Eucm{}), "eucm");
  EXPECT_EQ(model_name(OCam{}), "ocam");
  EXPECT_EQ(model_name(Equirectangular{}), "equirectangular");
  EXPECT_EQ(model_name(Mirror{}), "mirror");
  EXPECT_EQ(model_name(CentralRayTable{}), "ray-table");
  EXPECT_EQ(model_name(NonCentralRayTable{}), "ray-table");
}

TEST(Camera, OnlyMirrorsAndTablesCannotProject) {
  for (const CameraModel& model : {CameraModel(Pinhole{}), CameraModel(KannalaBrandt{}), CameraModel(OCam{}),
                                   CameraModel(Equirectangular{})}) {
    EXPECT_TRUE(make_camera(model).can_project()) << model_name(model);
  }
  for (const CameraModel& model :
       {CameraModel(Mirror{}), CameraModel(CentralRayTable{}), CameraModel(NonCentralRayTable{})}) {
    EXPECT_FALSE(make_camera(model).can_project());
    Eigen::Vector2d pixel;
    EXPECT_FALSE(make_camera(model).project({0, 0, 1}, &pixel));
  }
}

// On the axis a pixel of these is an angle of 1 / f, of 1 / (f / (1 + xi)) for the unified model.
TEST(Camera, PixelsPerRadianOfOtherModels) {
  EXPECT_NEAR(make_camera(KannalaBrandt{300, 300, 319.5, 239.5, 0.1}).pixels_per_radian(), 300, 0.01);
  EXPECT_NEAR(make_camera(Unified{300, 300, 319.5, 239.5, 0.5}).pixels_per_radian(), 200, 0.01);
  // 640 pixels for a turn, 480 for half of one.
  EXPECT_NEAR(make_camera(Equirectangular::for_image(640, 480)).pixels_per_radian(),
              std::sqrt(640 * 480 / 2.0) / 3.14159265, 0.01);
  // A mirror's centre is blind.
  const Mirror mirror =
      Mirror::from_parameters({1230, 1230, 319.5, 239.5, 0.1, 0, 0.083, 0, 0, 0.4, 0, 0, 0, 1, 0.02});
  Ray ray;
  ASSERT_FALSE(mirror.ray({319.5, 239.5}, &ray));
  EXPECT_GT(make_camera(mirror).pixels_per_radian(), 100);
}

}  // namespace
}  // namespace raysfm
