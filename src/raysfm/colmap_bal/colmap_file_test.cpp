// COLMAP itself is the judge of the model: it must open it, and what it understood is compared with what was
// written.
#include "raysfm/colmap_bal/colmap_file.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <map>
#include <sstream>

#include "raysfm/files/text_file.h"
#include "raysfm/scene/worlds.h"
#include "support/shell.h"
#include "support/small_reconstruction.h"
#include "support/temporary_folder.h"

namespace raysfm {
namespace {

namespace fs = std::filesystem;
using testing_support::content_of;
using testing_support::run;
using testing_support::small_reconstruction;
using testing_support::TemporaryFolder;

// Numbers that a text of ten digits holds exactly.
const Pinhole kPinhole{500, 510, 319.5, 239.5};
const Radtan kRadtan{500, 510, 320, 240, -0.125, 0.25, 0.0625, -0.03125};
const Radtan kRadtanK3{500, 510, 320, 240, -0.125, 0.25, 0.0625, -0.03125, 0.5};
const Rational kRational{500, 510, 320, 240, -0.125, 0.25, 0.0625, -0.03125, 0.5, 0.375, 0.75, 0.015625};

std::string quoted(const fs::path& path) {
  return "'" + path.string() + "'";
}

// The lines of a text model that are not comments.
std::vector<std::string> lines_of(const fs::path& path) {
  std::istringstream text(content_of(path));
  std::vector<std::string> lines;
  for (std::string line; std::getline(text, line);) {
    if (line.empty() || line[0] != '#') lines.push_back(line);
  }
  return lines;
}

class ColmapFile : public ::testing::Test {
 protected:
  // Writes the model, has COLMAP open it and say it in text.
  void convert(const Reconstruction& reconstruction) {
    if (!run("colmap help")) GTEST_SKIP() << "colmap is not installed";
    const Result<void> written = write_colmap_model(reconstruction, binary());
    ASSERT_TRUE(written.ok()) << written.error().message;
    fs::create_directories(text());
    ASSERT_TRUE(run("colmap model_converter --input_path " + quoted(binary()) + " --output_path " +
                    quoted(text()) + " --output_type TXT"));
  }
  fs::path binary() const { return folder_.path() / "sparse"; }
  fs::path text() const { return folder_.path() / "text"; }

  TemporaryFolder folder_;
};

TEST_F(ColmapFile, EveryCameraModel) {
  convert(small_reconstruction({kPinhole, kRadtan, kRadtanK3, kRational}));
  if (IsSkipped() || HasFatalFailure()) return;
  std::map<int, std::string> cameras;
  for (const std::string& line : lines_of(text() / "cameras.txt")) cameras[std::stoi(line)] = line;
  EXPECT_EQ(cameras[1], "1 PINHOLE 640 480 500 510 320 240");
  EXPECT_EQ(cameras[2], "2 OPENCV 640 480 500 510 320.5 240.5 -0.125 0.25 0.0625 -0.03125");
  EXPECT_EQ(cameras[3], "3 FULL_OPENCV 640 480 500 510 320.5 240.5 -0.125 0.25 0.0625 -0.03125 0.5 0 0 0");
  EXPECT_EQ(cameras[4],
            "4 FULL_OPENCV 640 480 500 510 320.5 240.5 -0.125 0.25 0.0625 -0.03125 0.5 0.375 0.75 0.015625");
}

TEST_F(ColmapFile, PosesAndPixelsOfARig) {
  const Reconstruction r = small_reconstruction({kPinhole, kRadtan});
  convert(r);
  if (IsSkipped() || HasFatalFailure()) return;
  const std::vector<std::string> lines = lines_of(text() / "images.txt");
  ASSERT_EQ(lines.size(), 2u * 4 * 2);  // two lines for each camera of four key frames
  int observations = 0;
  for (size_t i = 0; i < lines.size(); i += 2) {
    std::istringstream image(lines[i]);
    int id, camera_id;
    double qw, qx, qy, qz, tx, ty, tz;
    std::string name;
    image >> id >> qw >> qx >> qy >> qz >> tx >> ty >> tz >> camera_id >> name;
    const Camera& camera = r.rig.cameras[camera_id - 1];
    const int frame = std::stoi(name.substr(name.find("image_") + 6));
    EXPECT_EQ(name, camera.name + "/image_" + std::to_string(frame) + ".png");
    // COLMAP's own words: the centre is -R^T t, the rotation takes the world to the camera.
    const Eigen::Quaterniond rotation(qw, qx, qy, qz);
    const Rigid3 world_from_cam = *r.frames[frame].world_from_rig * camera.rig_from_cam;
    EXPECT_LT((-(rotation.conjugate() * Eigen::Vector3d(tx, ty, tz)) - world_from_cam.translation).norm(),
              1e-9);
    const Eigen::Vector3d axis_in_world = world_from_cam.rotation * Eigen::Vector3d::UnitX();
    EXPECT_LT((rotation * axis_in_world - Eigen::Vector3d::UnitX()).norm(), 1e-9);

    std::istringstream points(lines[i + 1]);
    double u, v;
    long point_id;
    while (points >> u >> v >> point_id) {
      Eigen::Vector2d pixel;
      ASSERT_TRUE(camera.project(world_from_cam.inverse() * r.points[point_id - 1].position, &pixel));
      EXPECT_LT((pixel + Eigen::Vector2d(0.5, 0.5) - Eigen::Vector2d(u, v)).norm(), 1e-9);
      ++observations;
    }
  }
  EXPECT_EQ(observations, static_cast<int>(r.observations.size()));
}

TEST_F(ColmapFile, TracksPointBackAtTheirObservations) {
  const Reconstruction r = small_reconstruction({kPinhole});
  convert(r);
  if (IsSkipped() || HasFatalFailure()) return;
  const std::vector<std::string> images = lines_of(text() / "images.txt");
  std::map<int, std::vector<long>> point_ids;  // of the points of each image
  for (size_t i = 0; i < images.size(); i += 2) {
    std::istringstream points(images[i + 1]);
    double u, v;
    for (long id; points >> u >> v >> id;) point_ids[std::stoi(images[i])].push_back(id);
  }
  size_t elements = 0;
  for (const std::string& line : lines_of(text() / "points3D.txt")) {
    std::istringstream point(line);
    long id;
    double x, y, z, error;
    int red, green, blue, image_id, index;
    point >> id >> x >> y >> z >> red >> green >> blue >> error;
    const MapPoint& expected = r.points[id - 1];
    EXPECT_LT((Eigen::Vector3d(x, y, z) - expected.position).norm(), 1e-12);
    EXPECT_EQ(green, expected.rgb[1]);
    EXPECT_LT(error, 1e-9);
    for (; point >> image_id >> index; ++elements) EXPECT_EQ(point_ids[image_id].at(index), id);
  }
  EXPECT_EQ(elements, r.observations.size());
}

TEST_F(ColmapFile, AnalyzerOpensIt) {
  convert(small_reconstruction({kRational}));
  if (IsSkipped() || HasFatalFailure()) return;
  EXPECT_TRUE(run("colmap model_analyzer --path " + quoted(binary())));
}

TEST_F(ColmapFile, ALensForEachKeyFrameOrForAll) {
  for (const bool zooming : {true, false}) {
    for (const RadialDistortion& radial : {RadialDistortion{}, RadialDistortion{-0.125, 0.0625}}) {
      Reconstruction r = testing_support::small_solved_reconstruction(zooming, radial);
      for (size_t i = 0; i < r.lenses.size(); ++i) {
        const double f = 500 + static_cast<double>(i);
        r.lenses[i].camera.model = frame_lens({f, f, 319.5, 239.5}, radial).camera.model;
      }
      if (!zooming) {  // half of the images tell it less well
        r.lenses.push_back(r.lenses[0]);
        r.lenses[1].sigma *= 2;
        for (int i = 6; i < 12; ++i) r.frames[i].lens = 1;
      }
      convert(r);
      if (IsSkipped() || HasFatalFailure()) return;
      EXPECT_TRUE(run("colmap model_analyzer --path " + quoted(binary())));
      std::map<int, std::string> cameras;
      for (const std::string& line : lines_of(text() / "cameras.txt")) cameras[std::stoi(line)] = line;
      ASSERT_EQ(cameras.size(), zooming ? 4u : 1u);
      EXPECT_EQ(cameras[1], radial.none() ? "1 PINHOLE 640 480 500 500 320 240"
                                          : "1 RADIAL 640 480 500 320 240 -0.125 0.0625");
      const std::vector<std::string> images = lines_of(text() / "images.txt");
      for (size_t i = 0; i < images.size(); i += 2) {
        const std::vector<std::string_view> words = split_words(images[i]);
        EXPECT_EQ(words[8], zooming ? words[0] : "1");  // camera and image
      }
      fs::remove_all(folder_.path() / "sparse");
    }
  }
}

TEST_F(ColmapFile, EachWorldHasAModelOfItsOwn) {
  Reconstruction r = small_reconstruction({kPinhole});
  r.segments = {{0, 2, "lost", false, {}}, {3, 11, "end of input", false, {}}};
  for (int i = 3; i < 12; ++i) {
    if (r.frames[i].world_from_rig) r.frames[i].segment = 1;
  }
  for (size_t i = 0; i < r.points.size(); i += 2) r.points[i].segment = 1;
  convert(world_of(r, 1));
  if (IsSkipped() || HasFatalFailure()) return;
  EXPECT_EQ(lines_of(text() / "images.txt").size(), 2u * 3);
  const std::vector<std::string> points = lines_of(text() / "points3D.txt");
  EXPECT_GT(points.size(), 50u);
  for (const std::string& line : points) {
    std::istringstream words(line);
    int id;
    Eigen::Vector3d position;
    words >> id >> position.x() >> position.y() >> position.z();
    EXPECT_LT((position - r.points[2 * (id - 1)].position).norm(), 1e-9) << line;
  }
}

TEST_F(ColmapFile, EmptyReconstruction) {
  Reconstruction r = small_reconstruction({kPinhole});
  r.keyframes.clear();
  convert(r);
}

}  // namespace
}  // namespace raysfm
