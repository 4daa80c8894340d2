#include "raysfm/exports/scene_formats.h"

#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "support/small_reconstruction.h"
#include "support/temporary_folder.h"

// Every reader here is made from the definition of its format, and sees the points where the map's
// observations, which are exact, have them.
namespace raysfm {
namespace {

namespace fs = std::filesystem;
using testing_support::content_of;
using testing_support::small_reconstruction;
using testing_support::small_solved_reconstruction;
using testing_support::TemporaryFolder;

constexpr double kTolerance = 1e-6;  // pixels

const Pinhole kCentred{500, 500, 319.5, 239.5};
const Radtan kRadtan{500, 510, 310.25, 245.5, -0.1, 0.02, 1e-3, -2e-3};
const KannalaBrandt kFisheye{300, 302, 330.5, 231.25, 0.01, -0.002, 1e-3, -1e-4};

ExportScene scene_of(const Reconstruction& world) {
  Result<ExportScene> scene = make_export_scene(world, false);
  EXPECT_TRUE(scene.ok());
  return *std::move(scene);
}

// OpenCV's models, normalised coordinates to pixels: fx fy cx cy, then k1 k2 p1 p2, or the k1 to k4 of
// fisheyes.
Eigen::Vector2d opencv(const std::vector<double>& p, double x, double y) {
  const double r2 = x * x + y * y, radial = 1 + p[4] * r2 + p[5] * r2 * r2;
  return {p[0] * (x * radial + 2 * p[6] * x * y + p[7] * (r2 + 2 * x * x)) + p[2],
          p[1] * (y * radial + p[6] * (r2 + 2 * y * y) + 2 * p[7] * x * y) + p[3]};
}
Eigen::Vector2d fisheye(const std::vector<double>& p, double x, double y) {
  const double r = std::hypot(x, y), t = std::atan(r), t2 = t * t;
  const double d = t * (1 + t2 * (p[4] + t2 * (p[5] + t2 * (p[6] + t2 * p[7]))));
  return {p[0] * d / r * x + p[2], p[1] * d / r * y + p[3]};
}

std::vector<double> numbers(const std::string& text) {
  std::istringstream stream(text);
  return {std::istream_iterator<double>(stream), {}};
}

std::vector<std::string> lines(const fs::path& path) {
  std::vector<std::string> lines;
  std::ifstream stream(path);
  for (std::string line; std::getline(stream, line);) {
    if (line.empty() || line[0] != '#') lines.push_back(line);
  }
  return lines;
}

void expect_same(const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
  EXPECT_LT((a - b).norm(), kTolerance) << a.transpose() << " and " << b.transpose();
}

// COLMAP's documentation of its text: pixels from the corner, images with the pose camera from world.
void expect_colmap_sees(const fs::path& model, const ExportScene& scene) {
  std::vector<std::vector<double>> cameras;
  std::vector<std::string> models;
  for (const std::string& line : lines(model / "cameras.txt")) {
    std::istringstream words(line);
    int id;
    std::string name;
    words >> id >> name;
    EXPECT_EQ(id, static_cast<int>(cameras.size() + 1));
    models.push_back(name);
    cameras.emplace_back(std::istream_iterator<double>(words), std::istream_iterator<double>());
    EXPECT_EQ(cameras.back()[0], 640);
    cameras.back().erase(cameras.back().begin(), cameras.back().begin() + 2);
    if (name == "PINHOLE") cameras.back().resize(8, 0.0);
  }
  const std::vector<std::string> images = lines(model / "images.txt"), points = lines(model / "points3D.txt");
  ASSERT_EQ(images.size(), 2 * scene.images.size());
  ASSERT_EQ(points.size(), scene.points.size());
  int seen = 0;
  for (size_t i = 0; i < scene.images.size(); ++i) {
    std::istringstream words(images[2 * i]);
    double id, qw, qx, qy, qz, tx, ty, tz;
    size_t camera;
    std::string name;
    words >> id >> qw >> qx >> qy >> qz >> tx >> ty >> tz >> camera >> name;
    EXPECT_EQ(name, scene.images[i].name);
    const Eigen::Matrix3d rotation = Eigen::Quaterniond(qw, qx, qy, qz).toRotationMatrix();
    const std::vector<double> keypoints = numbers(images[2 * i + 1]);
    ASSERT_EQ(keypoints.size(), 3 * scene.images[i].keypoints.size());
    for (size_t k = 0; k < keypoints.size(); k += 3) {
      const std::vector<double> point = numbers(points.at(static_cast<size_t>(keypoints[k + 2]) - 1));
      ASSERT_EQ(point[0], keypoints[k + 2]);
      const Eigen::Vector3d x =
          rotation * Eigen::Vector3d(point[1], point[2], point[3]) + Eigen::Vector3d(tx, ty, tz);
      const auto project = models[camera - 1] == "OPENCV_FISHEYE" ? fisheye : opencv;
      const Eigen::Vector2d from_corner = project(cameras[camera - 1], x.x() / x.z(), x.y() / x.z());
      expect_same(from_corner, {keypoints[k], keypoints[k + 1]});
      // The half pixel: what the project has from the centre of the first one.
      expect_same(from_corner - Eigen::Vector2d(0.5, 0.5), scene.images[i].keypoints[k / 3].pixel);
      ++seen;
    }
  }
  EXPECT_GT(seen, 200);
}

TEST(SceneFormats, ColmapText) {
  const TemporaryFolder temporary;
  const ExportScene scene = scene_of(small_reconstruction({kRadtan, kFisheye, kCentred}));
  ASSERT_TRUE(write_colmap(scene, true, temporary.path()).ok());
  expect_colmap_sees(temporary.path() / "sparse" / "0", scene);
  // The second camera of the rig, by its own place.
  const auto config = nlohmann::json::parse(content_of(temporary.path() / "rig_config.json"));
  ASSERT_EQ(config[0]["cameras"].size(), 3u);
  EXPECT_EQ(config[0]["cameras"][0]["image_prefix"], "cam0/");
  EXPECT_EQ(config[0]["cameras"][0]["ref_sensor"], true);
  const auto &q = config[0]["cameras"][1]["cam_from_rig_rotation"],
             &t = config[0]["cameras"][1]["cam_from_rig_translation"];
  const Eigen::Quaterniond rotation(q[0], q[1], q[2], q[3]);
  const Eigen::Vector3d in_rig(1, 2, 5), in_cam = rotation * in_rig + Eigen::Vector3d(t[0], t[1], t[2]);
  // small_reconstruction: the camera stands 0.3 to the right, turned by 0.2 about y.
  const Eigen::Vector3d expected =
      Eigen::AngleAxisd(-0.2, Eigen::Vector3d::UnitY()) * (in_rig - Eigen::Vector3d(0.3, 0, 0));
  EXPECT_LT((in_cam - expected).norm(), 1e-12);
}

TEST(SceneFormats, ColmapTextHoldsNoSpaces) {
  const TemporaryFolder temporary;
  ExportScene scene = scene_of(small_reconstruction({kCentred}));
  scene.images[1].name = "a b.png";
  const Result<void> text = write_colmap(scene, true, temporary.path());
  ASSERT_FALSE(text.ok());
  EXPECT_NE(text.error().message.find("'a b.png'"), std::string::npos);
  EXPECT_TRUE(write_colmap(scene, false, temporary.path()).ok());
}

// nerfstudio: image coordinates of the first pixel's centre are (0.5, 0.5); camera to world, -z view, y up.
void expect_nerfstudio_sees(const fs::path& folder, const ExportScene& scene, const char* model) {
  const auto json = nlohmann::json::parse(content_of(folder / "transforms.json"));
  ASSERT_EQ(json["camera_model"], model);
  ASSERT_EQ(json["frames"].size(), scene.images.size());
  const auto& applied = json["applied_transform"];
  for (size_t i = 0; i < scene.images.size(); ++i) {
    auto frame = json["frames"][i];
    EXPECT_EQ(frame["file_path"], "images/" + scene.images[i].name);
    const auto number = [&](const char* name) {
      if (frame.contains(name)) return frame[name].get<double>();
      return json.value(name, 0.0);
    };
    EXPECT_EQ(number("w"), 640);
    EXPECT_EQ(number("h"), 480);
    const bool wide = std::string(model) == "OPENCV_FISHEYE";
    const std::vector<double> p = {number("fl_x"),
                                   number("fl_y"),
                                   number("cx"),
                                   number("cy"),
                                   number("k1"),
                                   number("k2"),
                                   number(wide ? "k3" : "p1"),
                                   number(wide ? "k4" : "p2")};
    Eigen::Matrix4d world_from_cam, turned = Eigen::Matrix4d::Identity();
    for (int r = 0; r < 4; ++r) {
      for (int c = 0; c < 4; ++c) {
        world_from_cam(r, c) = frame["transform_matrix"][r][c];
        if (r < 3) turned(r, c) = applied[r][c];
      }
    }
    EXPECT_NEAR((world_from_cam.topLeftCorner<3, 3>().determinant()), 1, 1e-9);
    for (const ExportKeypoint& k : scene.images[i].keypoints) {
      const Eigen::Vector4d point = scene.points[k.point].position.homogeneous();
      const Eigen::Vector4d x = world_from_cam.inverse() * (turned * point);
      ASSERT_LT(x.z(), 0);
      expect_same((wide ? fisheye : opencv)(p, x.x() / -x.z(), -x.y() / -x.z()) - Eigen::Vector2d(0.5, 0.5),
                  k.pixel);
    }
  }
}

TEST(SceneFormats, Nerfstudio) {
  const TemporaryFolder temporary;
  ExportScene scene = scene_of(small_reconstruction({kRadtan}));
  scene.images[0].name = "q\"uote' \xc3\xa4.png";
  ASSERT_TRUE(write_nerfstudio(scene, temporary.path()).ok());
  expect_nerfstudio_sees(temporary.path(), scene, "OPENCV");
  EXPECT_TRUE(nlohmann::json::parse(content_of(temporary.path() / "transforms.json")).contains("fl_x"));
  // z of the points is up: what was y, downwards.
  const std::string ply = content_of(temporary.path() / "points.ply");
  float position[3];
  std::memcpy(position, ply.data() + ply.find("end_header\n") + 11, sizeof(position));
  const Eigen::Vector3f first = scene.points[0].position.cast<float>();
  EXPECT_EQ(position[0], first.x());
  EXPECT_EQ(position[1], first.z());
  EXPECT_EQ(position[2], -first.y());

  scene = scene_of(small_reconstruction({kFisheye, kFisheye}));
  ASSERT_TRUE(write_nerfstudio(scene, temporary.path()).ok());
  expect_nerfstudio_sees(temporary.path(), scene, "OPENCV_FISHEYE");
}

TEST(SceneFormats, NerfstudioWithALensForEveryFrame) {
  const TemporaryFolder temporary;
  Reconstruction world = small_solved_reconstruction(true, {});
  ExportScene scene = scene_of(world);
  ASSERT_EQ(scene.cameras.size(), scene.images.size());
  // The observations are those of another lens.
  for (ExportImage& image : scene.images) {
    for (ExportKeypoint& k : image.keypoints) {
      const Eigen::Vector3d x = image.world_from_cam.inverse() * scene.points[k.point].position;
      ASSERT_TRUE(scene.cameras[image.camera].project(x, &k.pixel));
    }
  }
  ASSERT_TRUE(write_nerfstudio(scene, temporary.path()).ok());
  expect_nerfstudio_sees(temporary.path(), scene, "OPENCV");
  const auto json = nlohmann::json::parse(content_of(temporary.path() / "transforms.json"));
  EXPECT_FALSE(json.contains("fl_x"));
  EXPECT_NE(json["frames"][0]["fl_x"], json["frames"][1]["fl_x"]);
}

TEST(SceneFormats, NerfstudioHasOneKindOfCamera) {
  const TemporaryFolder temporary;
  const Result<void> written =
      write_nerfstudio(scene_of(small_reconstruction({kCentred, kFisheye})), temporary.path());
  ASSERT_FALSE(written.ok());
  EXPECT_EQ(written.error().kind, ErrorKind::kBadInput);
  EXPECT_NE(written.error().message.find("--undistort"), std::string::npos);
}

// The definition of Bundler's files: P = R X + t, p = -P / P.z, p' = f (1 + k1 |p|^2 + k2 |p|^4) p, from the
// middle of the image, y up.
TEST(SceneFormats, Bundler) {
  const TemporaryFolder temporary;
  const ExportScene scene = scene_of(small_reconstruction({Radtan{480, 480, 319.5, 239.5, -0.08, 0.01}}));
  ASSERT_TRUE(write_bundler(scene, temporary.path()).ok());
  ASSERT_EQ(content_of(temporary.path() / "bundle.out").substr(0, 19), "# Bundle file v0.3\n");
  const std::string text = content_of(temporary.path() / "bundle.out").substr(19);
  std::istringstream words(text);
  size_t images = 0, points = 0, seen = 0;
  words >> images >> points;
  ASSERT_EQ(images, scene.images.size());
  ASSERT_EQ(points, scene.points.size());
  std::vector<std::array<double, 15>> cameras(images);
  for (auto& camera : cameras) {
    for (double& number : camera) words >> number;
  }
  for (size_t p = 0; p < points; ++p) {
    double x, y, z;
    int r, g, b;
    size_t count = 0;
    words >> x >> y >> z >> r >> g >> b >> count;
    EXPECT_EQ(r, scene.points[p].rgb[0]);
    for (; count > 0; --count, ++seen) {
      size_t image = 0, key = 0;
      double u, v;
      words >> image >> key >> u >> v;
      const auto& c = cameras.at(image);
      const Eigen::Matrix3d rotation = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(&c[3]);
      const Eigen::Vector3d P = rotation * Eigen::Vector3d(x, y, z) + Eigen::Vector3d(c[12], c[13], c[14]);
      const Eigen::Vector2d n = -P.head<2>() / P.z();
      const double r2 = n.squaredNorm();
      const Eigen::Vector2d pixel = c[0] * (1 + c[1] * r2 + c[2] * r2 * r2) * n;
      expect_same(pixel, {u, v});
      // 640 x 480 pixels: their middle is (319.5, 239.5) of the project.
      expect_same({319.5 + pixel.x(), 239.5 - pixel.y()}, scene.images[image].keypoints.at(key).pixel);
    }
  }
  EXPECT_TRUE(words.good() || words.eof());
  EXPECT_GT(seen, 100u);
  EXPECT_EQ(lines(temporary.path() / "list.txt").at(1), scene.images[1].name);
}

TEST(SceneFormats, WhatEachHolds) {
  Camera camera;
  camera.width = 640;
  camera.height = 480;
  const auto held = [&](const CameraModel& model) {
    camera.model = model;
    std::string held;
    if (colmap_holds(camera)) held += "c";
    if (nerfstudio_holds(camera)) held += "n";
    if (blender_holds(camera)) held += "b";
    if (bundler_holds(camera)) held += "B";
    return held;
  };
  EXPECT_EQ(held(kCentred), "cnbB");
  EXPECT_EQ(held(Pinhole{500, 500, 320.5, 239.5}), "cnb");
  EXPECT_EQ(held(Pinhole{500, 510, 319.5, 239.5}), "cnb");
  EXPECT_EQ(held(kRadtan), "cn");
  EXPECT_EQ(held(Radtan{500, 500, 319.5, 239.5, 0.1, -0.02}), "cnB");
  EXPECT_EQ(held(kFisheye), "cn");
  EXPECT_EQ(held(Unified{500, 500, 319.5, 239.5, 1.2, 0, 0, 0, 0}), "");
  EXPECT_EQ(held(Equirectangular::for_image(640, 480)), "");
  camera.width = 0;
  EXPECT_EQ(held(kCentred), "");
}

TEST(SceneFormats, BlenderHasOneSizeAndOneShapeOfPixels) {
  const TemporaryFolder temporary;
  Reconstruction world = small_reconstruction({kCentred, Pinhole{600, 600, 100, 200}});
  EXPECT_TRUE(write_blender(world, scene_of(world), temporary.path()).ok());
  world.rig.cameras[1].model = Pinhole{600, 700, 100, 200};
  Result<void> written = write_blender(world, scene_of(world), temporary.path());
  ASSERT_FALSE(written.ok());
  EXPECT_NE(written.error().message.find("--undistort"), std::string::npos);
  world.rig.cameras[1].width = 641;
  written = write_blender(world, scene_of(world), temporary.path());
  ASSERT_FALSE(written.ok());
  EXPECT_NE(written.error().message.find("641 x 480"), std::string::npos);
}

TEST(SceneFormats, NamesOfImages) {
  Reconstruction world = small_reconstruction({kCentred});
  world.frames[0].image_name = "../../outside.png";
  EXPECT_FALSE(make_export_scene(world, false).ok());
  world.frames[0].image_name = "photo one.JPG";
  world.frames[3].image_name = "";
  Result<ExportScene> scene = make_export_scene(world, false);
  ASSERT_TRUE(scene.ok());
  name_as_png(&*scene);
  EXPECT_EQ(scene->images[0].name, "photo one.png");
  EXPECT_EQ(scene->images[1].name, "frame-000003.png");
  // Two names that differ in their ending alone.
  world.frames[3].image_name = "photo one.bmp";
  scene = make_export_scene(world, false);
  ASSERT_TRUE(scene.ok());
  name_as_png(&*scene);
  EXPECT_EQ(scene->images[0].name, "photo one.JPG.png");
  EXPECT_EQ(scene->images[1].name, "photo one.bmp.png");
}

}  // namespace
}  // namespace raysfm
