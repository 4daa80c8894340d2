// The start on real images. OpenCV tracks the points, so that only the geometry is on trial.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <numbers>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>
#include <sstream>

#include "raysfm/camera/camera.h"
#include "raysfm/robust/three_view_start.h"
#include "support/pose_errors.h"
#include "support/shared_data.h"

namespace raysfm {
namespace {

using testing_support::kDegree;

using Eigen::Vector3d;

std::filesystem::path nth_file(const std::filesystem::path& folder, int n) {
  std::vector<std::filesystem::path> files;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) files.push_back(entry.path());
  std::sort(files.begin(), files.end());
  return files.at(n);
}

struct Sequence {
  std::string folder;
  Camera camera;
  int step;  // frames between the views

  std::filesystem::path image(int frame) const {
    const std::filesystem::path path = testing_support::shared_data(folder);
    if (folder == "fr1-rpy") return nth_file(path / "rgb", frame);
    char name[32];
    std::snprintf(name, sizeof name, folder == "kitti07-mono" ? "image_0/%06d.png" : "images/%06d.jpg",
                  frame);
    return path / name;
  }

  // One pose per frame; fr1-rpy has its own clock for the truth, so the nearest in time there.
  std::vector<Rigid3> world_from_cam() const {
    std::ifstream file(testing_support::shared_data(folder) / "truth.txt");
    std::vector<Rigid3> poses;
    std::vector<double> times;
    for (std::string line; std::getline(file, line);) {
      if (line.empty() || line[0] == '#') continue;
      std::istringstream stream(line);
      double time, q[4];
      Rigid3 pose;
      stream >> time >> pose.translation.x() >> pose.translation.y() >> pose.translation.z() >> q[0] >>
          q[1] >> q[2] >> q[3];
      pose.rotation = Eigen::Quaterniond(q[3], q[0], q[1], q[2]).normalized();
      poses.push_back(pose);
      times.push_back(time);
    }
    if (folder != "fr1-rpy") return poses;
    std::vector<Rigid3> nearest;
    for (int frame = 0; frame < 100; ++frame) {
      const double time = std::stod(image(frame).stem().string());
      const auto later = std::lower_bound(times.begin(), times.end(), time);
      nearest.push_back(poses.at(later - times.begin()));
    }
    return nearest;
  }
};

Sequence make_sequence(const std::string& folder, const CameraModel& model, int width, int height, int step) {
  Sequence sequence{folder, {}, step};
  sequence.camera.model = model;
  sequence.camera.width = width, sequence.camera.height = height;
  return sequence;
}

Sequence kitti() {
  return make_sequence("kitti07-mono", Pinhole{707.0912, 707.0912, 601.8873, 183.1104}, 1226, 370, 2);
}
Sequence tsukuba() {
  return make_sequence("tsukuba-mono", Pinhole{615, 615, 320, 240}, 640, 480, 5);
}
Sequence kitchen() {
  const Radtan model{526.238, 526.238, 319.5, 239.5, -0.0274262, 0, 0, 0};
  return make_sequence("redkitchen-handheld", model, 640, 480, 10);
}
Sequence turning() {
  const Radtan model{517.306408, 516.469215, 318.64304, 255.313989, 0.262383,
                     -0.953104,  -0.005358,  0.002628,  1.163314};
  return make_sequence("fr1-rpy", model, 640, 480, 4);
}

// Bearings of the points that OpenCV follows through the three images and back.
std::array<std::vector<Vector3d>, 3> track(const Sequence& sequence, int first) {
  std::array<cv::Mat, 3> images;
  for (int v = 0; v < 3; ++v) {
    images[v] = cv::imread(sequence.image(first + v * sequence.step).string(), cv::IMREAD_GRAYSCALE);
    EXPECT_FALSE(images[v].empty());
  }
  std::array<std::vector<cv::Point2f>, 3> points;
  std::array<std::vector<uchar>, 2> found;
  cv::goodFeaturesToTrack(images[0], points[0], 500, 0.005, 10);
  for (int v = 0; v < 2; ++v) {
    std::vector<float> error;
    std::vector<uchar> back_found;
    std::vector<cv::Point2f> back;
    cv::calcOpticalFlowPyrLK(images[v], images[v + 1], points[v], points[v + 1], found[v], error);
    cv::calcOpticalFlowPyrLK(images[v + 1], images[v], points[v + 1], back, back_found, error);
    for (size_t i = 0; i < back.size(); ++i) found[v][i] &= cv::norm(back[i] - points[v][i]) < 1.0;
  }
  std::array<std::vector<Vector3d>, 3> bearings;
  for (size_t i = 0; i < points[0].size(); ++i) {
    std::array<Ray, 3> rays;
    bool good = found[0][i] && found[1][i];
    for (int v = 0; v < 3; ++v)
      good = good && sequence.camera.ray({points[v][i].x, points[v][i].y}, &rays[v]);
    for (int v = 0; good && v < 3; ++v) bearings[v].push_back(rays[v].direction);
  }
  return bearings;
}

struct Tally {
  int right = 0, wrong = 0, refused = 0;
  std::string log;
};

Tally run(const Sequence& sequence, double max_rotation_deg, double max_direction_deg) {
  const std::vector<Rigid3> truth = sequence.world_from_cam();
  Tally tally;
  for (int first = 0; first + 2 * sequence.step < static_cast<int>(std::min<size_t>(truth.size(), 100));
       first += 6) {
    const auto bearings = track(sequence, first);
    ThreeViewOptions options;
    options.max_error = 1.5 / sequence.camera.pixels_per_radian();
    const ThreeViewStart start = start_from_three_views(bearings[0], bearings[1], bearings[2], options);
    tally.log += std::to_string(first) + ": " + describe(start);
    if (!start.ok()) {
      ++tally.refused;
      tally.log += "\n";
      continue;
    }
    const Rigid3 expected = truth[first + 2 * sequence.step].inverse() * truth[first];
    const double rotation =
        rotation_angle(start.cam2_from_cam0.rotation * expected.rotation.conjugate()) / kDegree;
    const Vector3d a = start.cam2_from_cam0.translation, b = expected.translation;
    const double direction = std::atan2(a.cross(b).norm(), a.dot(b)) / kDegree;
    const bool right = rotation < max_rotation_deg && direction < max_direction_deg;
    ++(right ? tally.right : tally.wrong);
    tally.log += ", off by " + std::to_string(rotation) + " and " + std::to_string(direction) + " degrees\n";
  }
  return tally;
}

TEST(ThreeViewStartOnRealImages, Driving) {
  RAYSFM_SKIP_WITHOUT_SHARED_DATA("kitti07-mono");
  const Tally tally = run(kitti(), 0.3, 3);
  EXPECT_GE(tally.right, 12) << tally.log;
  EXPECT_LE(tally.wrong, 1) << tally.log;
}

TEST(ThreeViewStartOnRealImages, Desk) {
  RAYSFM_SKIP_WITHOUT_SHARED_DATA("tsukuba-mono");
  const Tally tally = run(tsukuba(), 1.5, 10);
  EXPECT_GE(tally.right, 8) << tally.log;
  EXPECT_LE(tally.wrong, 1) << tally.log;
}

TEST(ThreeViewStartOnRealImages, Handheld) {
  RAYSFM_SKIP_WITHOUT_SHARED_DATA("redkitchen-handheld");
  const Tally tally = run(kitchen(), 2.5, 30);
  EXPECT_GE(tally.right, 5) << tally.log;
  EXPECT_LE(tally.wrong, 1) << tally.log;
}

TEST(ThreeViewStartOnRealImages, AlmostPureRotation) {
  RAYSFM_SKIP_WITHOUT_SHARED_DATA("fr1-rpy");
  const Tally tally = run(turning(), 2, 40);
  EXPECT_GE(tally.refused, 8) << tally.log;
  EXPECT_LE(tally.wrong, 1) << tally.log;
}

}  // namespace
}  // namespace raysfm
