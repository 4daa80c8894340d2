#include <fmt/format.h>

#include <cmath>
#include <iterator>

#include "raysfm/exports/path_formats.h"
#include "raysfm/files/atomic_file.h"
#include "raysfm/files/text_file.h"
#include "raysfm/results/ply_file.h"
#include "raysfm/results/trajectory_file.h"

namespace raysfm {
namespace {

namespace fs = std::filesystem;

// Of the first camera of the rig; of a lens there is no other.
Rigid3 rig_from_first_camera(const Reconstruction& world) {
  return world.rig.cameras.empty() ? Rigid3{} : world.rig.cameras.front().rig_from_cam;
}

const char* scale_of(const Reconstruction& world) {
  return world.metric_scale ? "metric" : "arbitrary";
}

}  // namespace

Result<void> write_tum(const Reconstruction& world, const fs::path& folder) {
  Trajectory trajectory;
  for (const PosedFrame& frame : world.frames) {
    if (!frame.world_from_rig) continue;
    trajectory.timestamps.push_back(frame.timestamp);
    trajectory.world_from_cam.push_back(*frame.world_from_rig * rig_from_first_camera(world));
  }
  return write_trajectory(trajectory,
                          fmt::format("world from camera; axes x right, y down, z forward; scale: {}\n"
                                      "timestamp tx ty tz qx qy qz qw",
                                      scale_of(world)),
                          folder / "trajectory.txt");
}

Result<void> write_kitti(const Reconstruction& world, const fs::path& folder) {
  std::string poses, times, frames;
  for (size_t f = 0; f < world.frames.size(); ++f) {
    if (!world.frames[f].world_from_rig) continue;
    const Rigid3 world_from_cam = *world.frames[f].world_from_rig * rig_from_first_camera(world);
    const Eigen::Matrix3d r = world_from_cam.rotation.toRotationMatrix();
    const Eigen::Vector3d& t = world_from_cam.translation;
    for (int i = 0; i < 3; ++i) {
      fmt::format_to(std::back_inserter(poses), "{} {} {} {}{}", r(i, 0), r(i, 1), r(i, 2), t[i],
                     i < 2 ? " " : "\n");
    }
    times += timestamp_text(world.frames[f].timestamp) + "\n";
    frames += fmt::format("{}\n", f);
  }
  Result<void> written = write_file(folder / "poses.txt", poses);
  if (written) written = write_file(folder / "times.txt", times);
  return written ? write_file(folder / "frames.txt", frames) : written;
}

Result<void> write_euroc(const Reconstruction& world, const fs::path& folder) {
  constexpr double kMostSeconds = 9e9;  // in 64 bits of nanoseconds
  std::string text =
      "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []\n";
  for (const PosedFrame& frame : world.frames) {
    if (!frame.world_from_rig) continue;
    if (!(std::abs(frame.timestamp) <= kMostSeconds)) {
      return bad_input(fmt::format("timestamp: {} is not allowed, EuRoC's nanoseconds hold {:g} seconds",
                                   frame.timestamp, kMostSeconds));
    }
    const auto& [q, t] = *frame.world_from_rig;
    fmt::format_to(std::back_inserter(text), "{},{},{},{},{},{},{},{}\n", std::llround(frame.timestamp * 1e9),
                   t.x(), t.y(), t.z(), q.w(), q.x(), q.y(), q.z());
  }
  return write_file(folder / "data.csv", text);
}

Result<void> write_ply(const Reconstruction& world, const fs::path& folder) {
  Reconstruction vertices;
  vertices.points = world.points;
  vertices.metric_scale = world.metric_scale;
  for (const PosedFrame& frame : world.frames) {
    if (!frame.world_from_rig) continue;
    const auto add = [&](const Rigid3& rig_from_cam) {
      vertices.points.push_back({(*frame.world_from_rig * rig_from_cam).translation, {255, 0, 0}});
    };
    if (world.rig.cameras.empty()) add({});
    for (const Camera& camera : world.rig.cameras) add(camera.rig_from_cam);
  }
  return write_points_ply(vertices, folder / "points.ply");
}

}  // namespace raysfm
