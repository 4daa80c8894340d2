// Calibrations as other tools published them: every file of the shared data is read, and what several of them
// say about one rig agrees.

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <set>

#include "raysfm/camera_files/camera_file.h"
#include "raysfm/frames/image_file.h"
#include "support/shared_data.h"

namespace raysfm {
namespace {

using namespace testing_support;
namespace fs = std::filesystem;

// Files below the folders that hold no camera, and why.
const std::map<std::string, std::string> kNoCalibrations = {
    {"calibration.yml", "a list of images"},
    {"stereo_calib.xml", "a list of images"},
    {"april_hilti.yaml", "a calibration board"},
    {"lidar_calibration.yaml", "poses of a LiDAR"},
};

std::vector<fs::path> calibration_files() {
  std::vector<fs::path> files;
  for (const char* folder : {"calibrations", "rigs"}) {
    for (const auto& entry : fs::recursive_directory_iterator(shared_data(folder))) {
      const std::string extension = entry.path().extension().string();
      const bool text = extension == ".yaml" || extension == ".yml" || extension == ".json" ||
                        extension == ".xml" || extension == ".txt";
      if (entry.is_regular_file() && text) files.push_back(entry.path());
    }
  }
  for (const auto& entry : fs::directory_iterator(shared_data(""))) {
    if (fs::exists(entry.path() / "camera.yaml")) files.push_back(entry.path() / "camera.yaml");
    if (fs::exists(entry.path() / "calib.txt")) files.push_back(entry.path() / "calib.txt");
  }
  for (const auto& entry : fs::directory_iterator(shared_data("rendered")))
    files.push_back(entry.path() / "camera.yaml");
  std::sort(files.begin(), files.end());
  return files;
}

TEST(CameraData, EveryCalibrationIsRead) {
  RAYSFM_SKIP_WITHOUT_SHARED_DATA("calibrations");
  int read = 0;
  std::set<std::string> models;
  for (const fs::path& file : calibration_files()) {
    const Result<Rig> rig = read_camera_file(file);
    if (kNoCalibrations.contains(file.filename().string())) {
      EXPECT_FALSE(rig) << file;
      continue;
    }
    ASSERT_TRUE(rig) << rig.error().message;
    ++read;
    for (const Camera& camera : rig->cameras) {
      models.insert(std::string(model_name(camera.model)));
      if (camera.width == 0) continue;
      Ray ray;
      EXPECT_TRUE(camera.ray({0.5 * camera.width, 0.5 * camera.height}, &ray)) << file;
      // Somewhere in front; the fisheye cameras see far beyond.
      EXPECT_GT(ray.direction.z(), model_name(camera.model) == "mirror" ? -1 : 0.9) << file << camera.name;
    }
  }
  EXPECT_GE(read, 40);
  for (const char* model : {"pinhole", "radtan", "kannala-brandt", "double-sphere", "eucm", "ocam",
                            "equirectangular", "mirror"}) {
    EXPECT_TRUE(models.contains(model)) << model;
  }
}

Rig shared_rig(const char* name) {
  const Result<Rig> rig = read_camera_file(shared_data(name));
  EXPECT_TRUE(rig) << rig.error().message;
  return *rig;
}

Rigid3 second_in_first(const Rig& rig) {
  return rig.cameras[0].rig_from_cam.inverse() * rig.cameras[1].rig_from_cam;
}

void expect_same_place(const Rig& a, const Rig& b, double metres, double radians) {
  const Rigid3 x = second_in_first(a), y = second_in_first(b);
  EXPECT_LT((x.translation - y.translation).norm(), metres);
  EXPECT_LT(x.rotation.angularDistance(y.rotation), radians);
}

TEST(CameraData, ToolsAgreeOnTheRigOfEuroc) {
  RAYSFM_SKIP_WITHOUT_SHARED_DATA("calibrations");
  const Rig kalibr = shared_rig("calibrations/kalibr/euroc_mav.yaml");
  EXPECT_NEAR(second_in_first(kalibr).translation.x(), 0.11, 0.001);  // to the right
  expect_same_place(kalibr, shared_rig("calibrations/basalt/euroc_ds_calib.json"), 0.002, 0.003);
  expect_same_place(kalibr, shared_rig("calibrations/stella/euroc_EuRoC_stereo.yaml"), 1e-4, 1e-4);
}

TEST(CameraData, ToolsAgreeOnTheRigOfTumVi) {
  RAYSFM_SKIP_WITHOUT_SHARED_DATA("calibrations");
  expect_same_place(shared_rig("calibrations/kalibr/tum_vi.yaml"),
                    shared_rig("calibrations/basalt/tumvi_512_eucm_calib.json"), 0.001, 0.002);
}

// Cameras on the outside of a rig look away from its middle.
void expect_outward(const Rig& rig) {
  Eigen::Vector3d middle = Eigen::Vector3d::Zero();
  for (const Camera& camera : rig.cameras) {
    middle += camera.rig_from_cam.translation / static_cast<double>(rig.cameras.size());
  }
  for (const Camera& camera : rig.cameras) {
    const Eigen::Vector3d outward = camera.rig_from_cam.translation - middle;
    const Eigen::Vector3d axis = camera.rig_from_cam.rotation * Eigen::Vector3d::UnitZ();
    EXPECT_GT(outward.normalized().dot(axis), 0.5) << camera.name;
  }
}

TEST(CameraData, RingsOfFisheyesLookOutward) {
  RAYSFM_SKIP_WITHOUT_SHARED_DATA("calibrations");
  const Rig omni = shared_rig("rigs/omnimvs-4-fisheye/config.yaml");
  ASSERT_EQ(omni.cameras.size(), 4u);
  expect_outward(omni);
  const Rig multicol = shared_rig("calibrations/multicol/MultiCamSys_Calibration.yaml");
  ASSERT_EQ(multicol.cameras.size(), 3u);
  expect_outward(multicol);
}

TEST(CameraData, SizesAreThoseOfTheImages) {
  RAYSFM_SKIP_WITHOUT_SHARED_DATA("rigs");
  const Rig omni = shared_rig("rigs/omnimvs-4-fisheye/config.yaml");
  for (const Camera& camera : omni.cameras) {
    const auto image = read_image(shared_data("rigs/omnimvs-4-fisheye/" + camera.name + "/00001.png"));
    ASSERT_TRUE(image) << image.error().message;
    EXPECT_EQ(image->gray.width(), camera.width);
    EXPECT_EQ(image->gray.height(), camera.height);
  }
}

}  // namespace
}  // namespace raysfm
