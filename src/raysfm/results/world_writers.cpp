#include "raysfm/results/world_writers.h"

#include <fmt/format.h>

#include "raysfm/colmap_bal/colmap_file.h"
#include "raysfm/files/atomic_file.h"
#include "raysfm/results/covariance_file.h"
#include "raysfm/results/output_folder.h"
#include "raysfm/results/ply_file.h"
#include "raysfm/results/trajectory_file.h"

namespace raysfm {
namespace {

namespace fs = std::filesystem;

std::string header(const Reconstruction& world, const char* what) {
  return fmt::format(
      "{}: world from rig; axes x right, y down, z forward; Hamilton quaternion\n"
      "scale: {}\n"
      "timestamp tx ty tz qx qy qz qw",
      what, world.metric_scale ? "metric, metres" : "arbitrary");
}

Result<void> write_frames(const Reconstruction& world, const fs::path& path) {
  return write_trajectory(posed_frames(world), header(world, "every frame with a pose"), path);
}

Result<void> write_keyframes(const Reconstruction& world, const fs::path& path) {
  return write_trajectory(posed_keyframes(world), header(world, "key frames"), path);
}

}  // namespace

std::span<const WorldWriter> world_writers() {
  static constexpr WorldWriter kWriters[] = {{"trajectory.txt", write_frames},
                                             {"keyframes.txt", write_keyframes},
                                             {"covariance.csv", write_covariance_csv},
                                             {"points.ply", write_points_ply},
                                             {"sparse", write_colmap_model}};
  return kWriters;
}

fs::path world_folder(int world) {
  return world == 0 ? fs::path(".") : fs::path("worlds") / std::to_string(world);
}

Result<void> write_world(const Reconstruction& world, const fs::path& folder) {
  if (auto created = create_folder(folder); !created) return created;
  for (const WorldWriter& writer : world_writers()) {
    if (auto r = writer.write(world, folder / writer.name); !r) return r;
  }
  return {};
}

}  // namespace raysfm
