// Writers of camera files: what is written and read again sees along the same rays, and OpenCV reads what is
// meant for it.

#include "raysfm/camera_files/camera_convert.h"

#include <gtest/gtest.h>

#include <fstream>
#include <opencv2/core.hpp>
#include <opencv2/core/persistence.hpp>

#include "raysfm/camera_files/camera_file.h"
#include "raysfm/frames/image_file.h"
#include "raysfm/plots/camera_plot.h"
#include "support/camera_texts.h"
#include "support/temporary_folder.h"

namespace raysfm {
namespace {

using namespace testing_support;

Camera camera_of(const CameraModel& model) {
  Camera camera;
  camera.name = "c";
  camera.model = model;
  camera.width = 640;
  camera.height = 480;
  return camera;
}

// Largest difference of the rays of two cameras over the image; pixels that only one of them sees count as 1.
double ray_difference(const Camera& a, const Camera& b) {
  double largest = 0;
  for (int v = 0; v < a.height; v += 20) {
    for (int u = 0; u < a.width; u += 20) {
      Ray x, y;
      const bool in_a = a.ray(Eigen::Vector2d(u, v), &x), in_b = b.ray(Eigen::Vector2d(u, v), &y);
      if (in_a != in_b) largest = std::max(largest, 1.0);
      if (in_a && in_b)
        largest = std::max({largest, (x.direction - y.direction).norm(), (x.origin - y.origin).norm()});
    }
  }
  return largest;
}

// Writes the files of a format into a folder and reads the one that holds the rig.
Rig there_and_back(const Rig& rig, std::string_view format) {
  const TemporaryFolder folder;
  const Result<std::vector<CameraFileText>> files = format_cameras(rig, format);
  EXPECT_TRUE(files) << files.error().message;
  if (!files) return {};
  for (const CameraFileText& file : *files) folder.file(file.name, file.text);
  const Result<Rig> again = read_camera_file(folder.path() / files->back().name);
  EXPECT_TRUE(again) << again.error().message;
  return again ? *again : Rig{};
}

const std::vector<CameraModel> kModels = {
    Pinhole{500, 501, 320.5, 240.25},
    Radtan{500, 501, 320.5, 240.25, -0.1, 0.02, 0.001, -0.002},
    Radtan{500, 501, 320.5, 240.25, -0.1, 0.02, 0.001, -0.002, 1e-3},
    Rational{500, 501, 320.5, 240.25, 0.1, 0.02, 0.001, -0.002, 1e-3, 0.2, 0.01, 1e-3},
    KannalaBrandt{200, 201, 320.5, 240.25, 0.01, -0.002, 0.001, -0.0001},
    Unified{600, 601, 320.5, 240.25, 1.1, -0.1, 0.01, 0.001, -0.001},
    Unified{600, 601, 320.5, 240.25, 1.1},
    DoubleSphere{180, 181, 320.5, 240.25, -0.2, 0.57},
    Eucm{230, 231, 320.5, 240.25, 0.6, 1.1},
    std::get<OCam>(parse_camera_file(kOCamCalibText, "f")->cameras[0].model),
};

TEST(CameraConvert, EquivalentModelsAreTheSameCamera) {
  size_t pairs = 0;
  for (const CameraModel& model : kModels) {
    for (const CameraModel& other : equivalent_models(model)) {
      ++pairs;
      EXPECT_LT(ray_difference(camera_of(model), camera_of(other)), 1e-9)
          << model_name(model) << " as " << model_name(other);
    }
  }
  EXPECT_GT(pairs, kModels.size() + 8);
}

TEST(CameraConvert, EveryFormatKeepsTheRays) {
  size_t kept = 0;
  for (std::string_view format : camera_formats()) {
    for (const CameraModel& model : kModels) {
      Rig rig{{camera_of(model)}};
      if (!format_cameras(rig, format)) continue;
      ++kept;
      const Rig again = there_and_back(rig, format);
      ASSERT_EQ(again.cameras.size(), 1u);
      EXPECT_LT(ray_difference(rig.cameras[0], again.cameras[0]), 1e-9) << format << " " << model_name(model);
    }
  }
  EXPECT_GT(kept, 30u);
}

TEST(CameraConvert, ModelsThatAFormatDoesNotHoldAreRefused) {
  const auto refused = [](const CameraModel& model, const char* format) {
    const auto files = format_cameras(Rig{{camera_of(model)}}, format);
    EXPECT_FALSE(files);
    return files ? "" : files.error().message;
  };
  EXPECT_NE(refused(DoubleSphere{180, 181, 320, 240, -0.2, 0.57}, "opencv").find("double-sphere"),
            std::string::npos);
  EXPECT_NE(refused(Radtan{500, 501, 320, 240, 0.1, 0, 0, 0, 0.1}, "kalibr").find("radtan"),
            std::string::npos);
  EXPECT_NE(refused(Pinhole{}, "nonsense").find("colmap"), std::string::npos);
  Camera unknown = camera_of(Pinhole{500, 500, 320, 240});
  unknown.width = 0;
  EXPECT_FALSE(format_cameras(Rig{{unknown}}, "colmap"));
}

// The first camera becomes the rig; what counts is where the others stand to it.
TEST(CameraConvert, RigsKeepTheirPlaces) {
  Rig rig{{camera_of(KannalaBrandt{200, 201, 320, 240}), camera_of(KannalaBrandt{210, 211, 321, 241})}};
  rig.cameras[0].rig_from_cam = {Eigen::Quaterniond(0.5, 0.5, -0.5, 0.5), Eigen::Vector3d(1, 2, 3)};
  rig.cameras[1].name = "d";
  rig.cameras[1].stream = 1;
  rig.cameras[1].rig_from_cam = {Eigen::Quaterniond(0.8, 0, 0.6, 0), Eigen::Vector3d(1.1, 2.2, 2.9)};
  const Rigid3 expected = rig.cameras[0].rig_from_cam.inverse() * rig.cameras[1].rig_from_cam;
  for (const char* format : {"raysfm", "kalibr", "opencv", "colmap", "basalt"}) {
    const Rig again = there_and_back(rig, format);
    ASSERT_EQ(again.cameras.size(), 2u) << format;
    const Rigid3 pose = again.cameras[0].rig_from_cam.inverse() * again.cameras[1].rig_from_cam;
    EXPECT_LT((pose.translation - expected.translation).norm(), 1e-9) << format;
    EXPECT_LT(pose.rotation.angularDistance(expected.rotation), 1e-9) << format;
    EXPECT_EQ(again.cameras[1].stream, 1) << format;
  }
}

TEST(CameraConvert, OpenCvReadsItsFormat) {
  const TemporaryFolder folder;
  const auto files = format_cameras(Rig{{camera_of(kModels[5])}}, "opencv");
  ASSERT_TRUE(files);
  const cv::FileStorage file(folder.file("c.yml", files->front().text).string(), cv::FileStorage::READ);
  cv::Mat k, d;
  file["camera_matrix"] >> k;
  file["distortion_coefficients"] >> d;
  EXPECT_EQ(k.at<double>(0, 0), 600);
  EXPECT_EQ(k.at<double>(1, 2), 240.25);
  EXPECT_EQ(d.at<double>(3), -0.001);
  EXPECT_EQ(static_cast<double>(file["xi"]), 1.1);
  EXPECT_EQ(static_cast<int>(file["image_width"]), 640);
}

// world2cam of OCamCalib with the inverse polynomial that was written.
TEST(CameraConvert, OCamCalibsInversePolynomialProjects) {
  const Camera camera = camera_of(kModels.back());
  const auto files = format_cameras(Rig{{camera}}, "ocamcalib");
  ASSERT_TRUE(files) << files.error().message;
  std::istringstream words(files->front().text);
  std::vector<std::vector<double>> groups;
  for (std::string line; std::getline(words, line);) {
    if (line.empty() || line[0] == '#') continue;
    std::istringstream numbers(line);
    groups.emplace_back(std::istream_iterator<double>(numbers), std::istream_iterator<double>());
  }
  ASSERT_EQ(groups.size(), 5u);
  for (const Eigen::Vector2d& pixel :
       {Eigen::Vector2d(10, 470), Eigen::Vector2d(400, 100), Eigen::Vector2d(630, 30)}) {
    Ray ray;
    ASSERT_TRUE(camera.ray(pixel, &ray));
    const Eigen::Vector3d m(ray.direction.y(), ray.direction.x(), -ray.direction.z());  // OCamCalib's axes
    const double r = std::hypot(m.x(), m.y()), theta = std::atan(m.z() / r);
    double rho = 0, power = 1;
    for (size_t i = 1; i < groups[1].size(); ++i, power *= theta) rho += groups[1][i] * power;
    const double x = m.x() / r * rho, y = m.y() / r * rho;
    const double row = groups[3][0] * x + groups[3][1] * y + groups[2][0];
    const double column = groups[3][2] * x + y + groups[2][1];
    EXPECT_NEAR(row, pixel.y(), 0.01);
    EXPECT_NEAR(column, pixel.x(), 0.01);
  }
}

TEST(CameraConvert, TheProjectsFileHoldsEveryModel) {
  const Rig rig = *parse_camera_file(kManyModelsYaml, "f");
  const Rig again = there_and_back(rig, "raysfm");
  ASSERT_EQ(again.cameras.size(), rig.cameras.size());
  for (size_t i = 0; i < rig.cameras.size(); ++i) {
    EXPECT_EQ(ray_difference(rig.cameras[i], again.cameras[i]), 0) << rig.cameras[i].name;
  }
  EXPECT_EQ(format_camera_file(again), format_camera_file(rig));
}

TEST(CameraConvert, TablesKeepTheirHoles) {
  RayGridData grid;
  grid.max_x = 639;
  grid.max_y = 479;
  grid.grid_width = 7;
  grid.grid_height = 6;
  for (int i = 0; i < 42; ++i) grid.directions.emplace_back(i % 7 - 3, i / 7 - 2.5, 2);
  grid.directions[0].setConstant(std::nan(""));
  const Rig rig{{camera_of(CentralRayTable(grid))}};
  const std::string text = format_camera_file(rig);
  EXPECT_NE(text.find("~, ~, ~"), std::string::npos);
  const Rig again = there_and_back(rig, "raysfm");
  EXPECT_EQ(format_camera_file(again), text);
  EXPECT_EQ(ray_difference(rig.cameras[0], again.cameras[0]), 0);
  Ray ray;
  EXPECT_FALSE(again.cameras[0].ray({0, 0}, &ray));
  EXPECT_TRUE(again.cameras[0].ray({320, 240}, &ray));
}

TEST(CameraConvert, GenericModelsComeBack) {
  const Rig rig = *parse_camera_file(kGenericYaml, "f");
  EXPECT_EQ(ray_difference(rig.cameras[0], there_and_back(rig, "generic").cameras[0]), 0);
}

TEST(CameraPlot, DrawsARowForEachCamera) {
  const TemporaryFolder folder;
  const Rig rig = *parse_camera_file(kManyModelsYaml, "f");
  ASSERT_TRUE(plot_cameras(rig, folder.path() / "plot.png"));
  const auto picture = read_image(folder.path() / "plot.png");
  ASSERT_TRUE(picture) << picture.error().message;
  EXPECT_GT(picture->gray.height(), 400 * static_cast<int>(rig.cameras.size() + 1));
  Rig unknown{{camera_of(Pinhole{})}};
  unknown.cameras[0].width = 0;
  EXPECT_FALSE(plot_cameras(unknown, folder.path() / "none.png"));
}

}  // namespace
}  // namespace raysfm
