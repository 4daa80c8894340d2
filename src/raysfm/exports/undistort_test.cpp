#include "raysfm/exports/undistort.h"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <set>

#include "raysfm/exports/pinhole_images.h"
#include "raysfm/exports/scene_formats.h"
#include "raysfm/frames/image_writer.h"
#include "support/small_reconstruction.h"
#include "support/temporary_folder.h"

namespace raysfm {
namespace {

using testing_support::small_reconstruction;
using testing_support::small_solved_reconstruction;
using testing_support::TemporaryFolder;

// f (x/z, y/z) from the middle of the image, of what a pinhole of the new scene should see.
void expect_points_where_pinholes_see_them(const ExportScene& scene, size_t at_least) {
  size_t seen = 0;
  for (const ExportImage& image : scene.images) {
    const Camera& camera = scene.cameras[image.camera];
    const Pinhole& m = std::get<Pinhole>(camera.model);
    EXPECT_EQ(m.fx, m.fy);
    EXPECT_EQ(m.cx, (camera.width - 1) / 2.0);
    for (const ExportKeypoint& k : image.keypoints) {
      const Eigen::Vector3d x = image.world_from_cam.inverse() * scene.points[k.point].position;
      ASSERT_GT(x.z(), 0);
      const Eigen::Vector2d pixel(m.fx * x.x() / x.z() + m.cx, m.fy * x.y() / x.z() + m.cy);
      EXPECT_LT((pixel - k.pixel).norm(), 1e-6);
      ++seen;
    }
  }
  EXPECT_GE(seen, at_least);
}

UndistortedScene pinholes_of(const Reconstruction& world) {
  const Result<ExportScene> scene = make_export_scene(world, false);
  EXPECT_TRUE(scene.ok());
  Result<UndistortedScene> made = undistort(*scene);
  EXPECT_TRUE(made.ok());
  return *std::move(made);
}

TEST(Undistort, ANarrowLensBecomesOnePinhole) {
  const Reconstruction world =
      small_reconstruction({Radtan{500, 510, 310.25, 245.5, -0.1, 0.02, 1e-3, -2e-3}});
  const UndistortedScene made = pinholes_of(world);
  ASSERT_EQ(made.scene.cameras.size(), 1u);
  EXPECT_EQ(made.scene.images[0].name, "image_0.png");
  EXPECT_EQ(made.scene.cameras[0].width, 640);
  expect_points_where_pinholes_see_them(made.scene, world.observations.size() * 9 / 10);
  EXPECT_TRUE(bundler_holds(made.scene.cameras[0]).ok());
}

// The principal point is far to the left: the pinhole, whose own is in the middle, does not see what is at
// the right.
TEST(Undistort, PointsOfOneImageAreLeftOut) {
  const Reconstruction world = small_reconstruction({Pinhole{500, 500, 119.5, 239.5}});
  const UndistortedScene made = pinholes_of(world);
  EXPECT_LT(made.scene.points.size(), world.points.size());
  EXPECT_GT(made.scene.points.size(), 10u);
  std::vector<int> images(made.scene.points.size(), 0);
  for (const ExportImage& image : made.scene.images) {
    for (const ExportKeypoint& k : image.keypoints) ++images.at(k.point);
  }
  for (const int count : images) EXPECT_GE(count, 2);
  expect_points_where_pinholes_see_them(made.scene, 2 * made.scene.points.size());
}

TEST(Undistort, APanoramaBecomesACube) {
  Reconstruction world = small_reconstruction({Equirectangular::for_image(640, 480)});
  const UndistortedScene made = pinholes_of(world);
  std::set<std::string> names;
  for (const Camera& camera : made.scene.cameras) {
    names.insert(camera.name);
    EXPECT_EQ(camera.width, camera.height);
    // 90 degrees from edge to edge.
    EXPECT_NEAR(std::get<Pinhole>(camera.model).fx, camera.width / 2.0, 1e-12);
  }
  EXPECT_EQ(names, (std::set<std::string>{"cam0_front", "cam0_right", "cam0_back", "cam0_left", "cam0_down",
                                          "cam0_up"}));
  EXPECT_TRUE(made.scene.rig);
  EXPECT_EQ(made.scene.images.size(), 24u);
  EXPECT_EQ(made.scene.images[1].name, "right/image_0.png");
  // Every point is in one face of each image, but for those on an edge.
  expect_points_where_pinholes_see_them(made.scene, world.observations.size() - 2);
}

TEST(Undistort, AFisheyeOfARigKeepsTheFacesThatItSees) {
  const Reconstruction world =
      small_reconstruction({Pinhole{500, 500, 319.5, 239.5}, KannalaBrandt{200, 200, 320, 240, 0, 0, 0, 0}});
  const UndistortedScene made = pinholes_of(world);
  std::set<std::string> names;
  for (const Camera& camera : made.scene.cameras) names.insert(camera.name);
  EXPECT_TRUE(names.contains("cam0"));
  EXPECT_TRUE(names.contains("cam1_front"));
  EXPECT_TRUE(names.contains("cam1_left"));
  EXPECT_FALSE(names.contains("cam1_back"));
  for (const ExportImage& image : made.scene.images) {
    EXPECT_EQ(image.name.substr(0, image.name.find('/')), made.scene.cameras[image.camera].name);
  }
  expect_points_where_pinholes_see_them(made.scene, world.observations.size() * 8 / 10);
}

TEST(Undistort, SkewIsTakenOut) {
  Reconstruction world = small_solved_reconstruction(false, {});
  world.lenses[0].skew = 4;
  Result<ExportScene> scene = make_export_scene(world, false);
  ASSERT_TRUE(scene.ok());
  const Lens lens = *lens_of(world.lenses[0]);
  size_t seen = 0;
  for (ExportImage& image : scene->images) {
    seen += image.keypoints.size();
    for (ExportKeypoint& k : image.keypoints) {
      const Eigen::Vector3d x = image.world_from_cam.inverse() * scene->points[k.point].position;
      k.pixel = lens.pixel(x.hnormalized());
    }
  }
  const Result<UndistortedScene> made = undistort(*scene);
  ASSERT_TRUE(made.ok());
  expect_points_where_pinholes_see_them(made->scene, seen * 9 / 10);
}

TEST(Undistort, PixelsAndDirectionsAreInverse) {
  const Reconstruction world = small_reconstruction({KannalaBrandt{160, 160, 330, 250, 0.01, 0, 0, 0}});
  Camera skewed;
  skewed.model = Pinhole{500, 510, 310, 250};
  skewed.width = 640;
  skewed.height = 480;
  for (const PinholeSource& source :
       {PinholeSource(skewed, 6, 1), PinholeSource(world.rig.cameras[0], 0, 5)}) {
    for (const Eigen::Vector2d& pixel : {Eigen::Vector2d(300, 20), Eigen::Vector2d(500, 400)}) {
      Eigen::Vector3d direction;
      Eigen::Vector2d back;
      ASSERT_TRUE(source.direction(pixel, &direction));
      ASSERT_TRUE(source.pixel(direction, &back));
      EXPECT_LT((back - pixel).norm(), 1e-6);
    }
  }
}

// Frames whose grey tells the direction of each pixel: what is resampled must show that of the new pixel.
double grey_of(const Eigen::Vector3d& direction) {
  const Eigen::Vector3d d = direction.normalized();
  return 128 + 60 * std::sin(3 * d.x() + 1) + 50 * std::cos(2 * d.y() - d.z());
}

void expect_images_show_their_directions(const CameraModel& model, double seen_at_least) {
  const TemporaryFolder temporary;
  const Reconstruction world = small_reconstruction({model});
  Result<ExportScene> scene = make_export_scene(world, false);
  ASSERT_TRUE(scene.ok());
  const Result<UndistortedScene> made = undistort(*scene);
  ASSERT_TRUE(made.ok());
  GrayImage image(640, 480);
  for (int y = 0; y < 480; ++y) {
    for (int x = 0; x < 640; ++x) {
      Ray ray;
      const bool seen = scene->cameras[0].ray({x, y}, &ray);
      image.row(y)[x] = seen ? static_cast<uint8_t>(std::lround(grey_of(ray.direction))) : 0;
    }
  }
  const std::filesystem::path frames = temporary.path() / "frames", out = temporary.path() / "out";
  std::filesystem::create_directory(frames);
  for (size_t i = 0; i < world.frames.size(); ++i) {
    ASSERT_TRUE(write_png(frames / ("image_" + std::to_string(i) + ".png"), image).ok());
  }
  const Result<void> written = write_images({{frames.string()}, {}, 1}, world, *scene, &*made, out);
  ASSERT_TRUE(written.ok()) << written.error().message;
  int seen = 0, pixels = 0;
  for (size_t i = 0; i < made->scene.cameras.size(); ++i) {
    const ExportImage& made_image = made->scene.images[i];
    const Camera& camera = made->scene.cameras[made_image.camera];
    const Pinhole& m = std::get<Pinhole>(camera.model);
    const cv::Mat png = cv::imread((out / made_image.name).string(), cv::IMREAD_GRAYSCALE);
    ASSERT_EQ(png.cols, camera.width);
    const Eigen::Matrix3d cam_from_face =
        (scene->images[0].world_from_cam.rotation.conjugate() * made_image.world_from_cam.rotation)
            .toRotationMatrix();
    for (int y = 0; y < png.rows; ++y) {
      for (int x = 0; x < png.cols; ++x) {
        const int grey = png.at<uint8_t>(y, x);
        ++pixels;
        if (grey == 0) continue;
        ++seen;
        const Eigen::Vector3d direction =
            cam_from_face * Eigen::Vector3d((x - m.cx) / m.fx, (y - m.cy) / m.fy, 1);
        EXPECT_NEAR(grey, grey_of(direction), 3) << made_image.name << " " << x << " " << y;
      }
    }
  }
  EXPECT_GT(seen, seen_at_least * pixels);
}

TEST(Undistort, ImagesOfALens) {
  expect_images_show_their_directions(Radtan{500, 510, 310.25, 245.5, -0.1, 0.02, 1e-3, -2e-3}, 0.95);
}

TEST(Undistort, ImagesOfAFisheye) {
  expect_images_show_their_directions(KannalaBrandt{160, 160, 330, 250, 0.01, 0, 0, 0}, 0.4);
}

TEST(Undistort, FramesThatDoNotFit) {
  const TemporaryFolder temporary;
  const Reconstruction world = small_reconstruction({Pinhole{500, 500, 319.5, 239.5}});
  const Result<ExportScene> scene = make_export_scene(world, false);
  const std::filesystem::path frames = temporary.path() / "frames", out = temporary.path() / "out";
  std::filesystem::create_directory(frames);
  const auto said = [&] {
    const Result<void> written = write_images({{frames.string()}, {}, 1}, world, *scene, nullptr, out);
    return written ? std::string() : written.error().message;
  };
  const auto write = [&](int number, int width, const std::string& prefix) {
    GrayImage image(width, 480);
    for (int y = 0; y < 480; ++y) std::fill_n(image.row(y), width, 90);
    ASSERT_TRUE(write_png(frames / (prefix + std::to_string(number) + ".png"), image).ok());
  };
  for (int i = 0; i < 5; ++i) write(i, 640, "image_");
  EXPECT_NE(said().find("5 frames are not enough"), std::string::npos) << said();
  for (int i = 5; i < 12; ++i) write(i, 640, "image_");
  EXPECT_EQ(said(), "");
  write(3, 320, "image_");
  EXPECT_NE(said().find("320 x 480"), std::string::npos) << said();
  std::filesystem::remove(frames / "image_0.png");
  write(0, 640, "another_");
  EXPECT_NE(said().find("'another_0.png'"), std::string::npos) << said();
}

}  // namespace
}  // namespace raysfm
