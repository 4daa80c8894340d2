#include "raysfm/exports/path_formats.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <sstream>

#include "support/small_reconstruction.h"
#include "support/temporary_folder.h"

namespace raysfm {
namespace {

using testing_support::content_of;
using testing_support::small_reconstruction;
using testing_support::TemporaryFolder;

// A rig whose first camera is not its origin, and a frame without a pose.
Reconstruction example() {
  Reconstruction r = small_reconstruction({Pinhole{500, 510, 310, 250}, Pinhole{500, 510, 310, 250}});
  std::swap(r.rig.cameras[0].rig_from_cam, r.rig.cameras[1].rig_from_cam);
  return r;
}

std::vector<std::vector<double>> rows(const std::string& text, const std::string& separators = " ") {
  std::vector<std::vector<double>> rows;
  std::istringstream stream(text);
  for (std::string line; std::getline(stream, line);) {
    if (line.empty() || line[0] == '#') continue;
    for (char& c : line) c = separators.find(c) != std::string::npos ? ' ' : c;
    std::istringstream words(line);
    rows.emplace_back(std::istream_iterator<double>(words), std::istream_iterator<double>());
  }
  return rows;
}

// Of a point of the map, by the pose of a format and the pinhole of the example.
Eigen::Vector2d pixel(const Eigen::Matrix3d& world_from_cam, const Eigen::Vector3d& centre,
                      const Eigen::Vector3d& point) {
  const Eigen::Vector3d x = world_from_cam.transpose() * (point - centre);
  return {500 * x.x() / x.z() + 310, 510 * x.y() / x.z() + 250};
}

Eigen::Vector2d expected(const Reconstruction& r, int frame, const Rigid3& rig_from_cam,
                         const Eigen::Vector3d& point) {
  const Eigen::Vector3d x = (*r.frames[frame].world_from_rig * rig_from_cam).inverse() * point;
  Eigen::Vector2d pixel;
  EXPECT_TRUE(r.rig.cameras[0].project(x, &pixel));
  return pixel;
}

int frame_of_line(size_t line) {
  return static_cast<int>(line < 5 ? line : line + 1);
}

TEST(PathFormats, Tum) {
  const TemporaryFolder temporary;
  const Reconstruction r = example();
  ASSERT_TRUE(write_tum(r, temporary.path()).ok());
  const auto lines = rows(content_of(temporary.path() / "trajectory.txt"));
  ASSERT_EQ(lines.size(), 11u);
  const Eigen::Vector3d point(1, 0.5, 8);
  for (size_t i = 0; i < lines.size(); ++i) {
    const auto& v = lines[i];
    EXPECT_EQ(v[0], r.frames[frame_of_line(i)].timestamp);
    const Eigen::Matrix3d rotation = Eigen::Quaterniond(v[7], v[4], v[5], v[6]).toRotationMatrix();
    EXPECT_LT((pixel(rotation, {v[1], v[2], v[3]}, point) -
               expected(r, frame_of_line(i), r.rig.cameras[0].rig_from_cam, point))
                  .norm(),
              1e-6);
  }
}

TEST(PathFormats, Kitti) {
  const TemporaryFolder temporary;
  const Reconstruction r = example();
  ASSERT_TRUE(write_kitti(r, temporary.path()).ok());
  const auto poses = rows(content_of(temporary.path() / "poses.txt"));
  const auto times = rows(content_of(temporary.path() / "times.txt"));
  const auto frames = rows(content_of(temporary.path() / "frames.txt"));
  ASSERT_EQ(poses.size(), 11u);
  ASSERT_EQ(times.size(), 11u);
  const Eigen::Vector3d point(1, 0.5, 8);
  for (size_t i = 0; i < poses.size(); ++i) {
    ASSERT_EQ(poses[i].size(), 12u);
    EXPECT_EQ(frames.at(i).at(0), frame_of_line(i));
    EXPECT_EQ(times[i][0], r.frames[frame_of_line(i)].timestamp);
    const Eigen::Matrix<double, 3, 4> m =
        Eigen::Map<const Eigen::Matrix<double, 3, 4, Eigen::RowMajor>>(poses[i].data());
    EXPECT_LT((pixel(m.leftCols<3>(), m.col(3), point) -
               expected(r, frame_of_line(i), r.rig.cameras[0].rig_from_cam, point))
                  .norm(),
              1e-6);
  }
}

TEST(PathFormats, Euroc) {
  const TemporaryFolder temporary;
  Reconstruction r = example();
  r.frames[0].timestamp = 99.123456789;
  ASSERT_TRUE(write_euroc(r, temporary.path()).ok());
  const std::string text = content_of(temporary.path() / "data.csv");
  EXPECT_EQ(text.substr(0, 15), "#timestamp [ns]");
  EXPECT_EQ(text.substr(text.find('\n') + 1, 12), "99123456789,");
  const auto lines = rows(text, ",");
  ASSERT_EQ(lines.size(), 11u);
  const Eigen::Vector3d point(1, 0.5, 8);
  for (size_t i = 0; i < lines.size(); ++i) {
    const auto& v = lines[i];
    const Eigen::Matrix3d rotation = Eigen::Quaterniond(v[4], v[5], v[6], v[7]).toRotationMatrix();
    EXPECT_LT((pixel(rotation, {v[1], v[2], v[3]}, point) - expected(r, frame_of_line(i), {}, point)).norm(),
              1e-6);
  }
  r.frames[2].timestamp = 1e10;
  EXPECT_FALSE(write_euroc(r, temporary.path()).ok());
}

TEST(PathFormats, PlyHasPointsAndCameras) {
  const TemporaryFolder temporary;
  const Reconstruction r = example();
  ASSERT_TRUE(write_ply(r, temporary.path()).ok());
  const std::string bytes = content_of(temporary.path() / "points.ply");
  EXPECT_NE(bytes.find("element vertex 222\n"), std::string::npos);  // 200 points, 11 frames of 2 cameras
  const char* last = bytes.data() + bytes.size() - 15;
  float position[3];
  std::memcpy(position, last, sizeof(position));
  const Eigen::Vector3f camera =
      (*r.frames[11].world_from_rig * r.rig.cameras[1].rig_from_cam).translation.cast<float>();
  EXPECT_EQ(Eigen::Vector3f(position[0], position[1], position[2]), camera);
  EXPECT_EQ(static_cast<uint8_t>(last[12]), 255);
  EXPECT_EQ(static_cast<uint8_t>(last[13]), 0);
}

}  // namespace
}  // namespace raysfm
