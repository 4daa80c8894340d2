#include "raysfm/results/world_writers.h"

#include <fmt/format.h>

#include <algorithm>

#include "raysfm/colmap_bal/colmap_file.h"
#include "raysfm/files/atomic_file.h"
#include "raysfm/results/covariance_file.h"
#include "raysfm/results/lens_file.h"
#include "raysfm/results/observations_file.h"
#include "raysfm/results/output_folder.h"
#include "raysfm/results/ply_file.h"
#include "raysfm/results/trajectory_file.h"

namespace raysfm {
namespace {

namespace fs = std::filesystem;

std::string header(const Reconstruction& world, const char* what) {
  const bool solved = world.origin == Origin::kSolve;  // in the unit of the known structure, if at all
  return fmt::format(
      "{}: world from {}; axes x right, y down, z forward; Hamilton quaternion\n"
      "scale: {}\n"
      "timestamp tx ty tz qx qy qz qw",
      what, solved ? "camera" : "rig",
      !world.metric_scale ? "arbitrary"
      : solved            ? "of the known structure"
                          : "metric, metres");
}

Result<void> write_frames(const Reconstruction& world, const fs::path& path) {
  return write_trajectory(posed_frames(world), header(world, "every frame with a pose"), path);
}

Result<void> write_keyframes(const Reconstruction& world, const fs::path& path) {
  return write_trajectory(posed_keyframes(world), header(world, "key frames"), path);
}

}  // namespace

std::span<const WorldWriter> world_writers() {
  static constexpr Origin kAll[] = {Origin::kTrack, Origin::kSolve, Origin::kAdjust};
  static constexpr std::span<const Origin> kFromImages = std::span(kAll).first(2), kTracked(kAll, 1),
                                           kSolved(&kAll[1], 1);
  static constexpr WorldWriter kWriters[] = {{"trajectory.txt", kFromImages, write_frames},
                                             {"keyframes.txt", kFromImages, write_keyframes},
                                             {"covariance.csv", kFromImages, write_covariance_csv},
                                             {"points.ply", kAll, write_points_ply},
                                             {"lens.csv", kSolved, write_lens_file},
                                             {"sparse", kFromImages, write_colmap_model},
                                             {"observations.csv", kTracked, write_observations_csv}};
  return kWriters;
}

fs::path world_folder(int world) {
  return world == 0 ? fs::path(".") : fs::path("worlds") / std::to_string(world);
}

Result<void> write_world(const Reconstruction& world, const fs::path& folder) {
  if (auto created = create_folder(folder); !created) return created;
  for (const WorldWriter& writer : world_writers()) {
    if (std::ranges::find(writer.origins, world.origin) == writer.origins.end()) continue;
    if (auto r = writer.write(world, folder / writer.name); !r) return r;
  }
  return {};
}

}  // namespace raysfm
