#include "raysfm/io/output_folder.h"

#include <fmt/format.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <system_error>

#include "raysfm/io/atomic_file.h"
#include "raysfm/io/colmap_file.h"
#include "raysfm/io/covariance_file.h"
#include "raysfm/io/ply_file.h"
#include "raysfm/io/trajectory_file.h"

namespace raysfm {
namespace {

void append(const PosedFrame& frame, Trajectory* trajectory) {
  if (!frame.world_from_rig) return;
  trajectory->timestamps.push_back(frame.timestamp);
  trajectory->world_from_cam.push_back(*frame.world_from_rig);
}

std::string trajectory_header(const Reconstruction& reconstruction, const char* what) {
  std::string header = fmt::format(
      "{}: world from rig; axes x right, y down, z forward; Hamilton quaternion\n"
      "scale: {}\n",
      what, reconstruction.metric_scale ? "metric, metres" : "arbitrary");
  if (reconstruction.segments.size() > 1) {
    header += "the segments below share neither world nor scale\n";
    for (const Segment& segment : reconstruction.segments) {
      header += fmt::format("segment: {:.9f} to {:.9f} s\n", reconstruction.frames[segment.first].timestamp,
                            reconstruction.frames[segment.last].timestamp);
    }
  }
  return header + "timestamp tx ty tz qx qy qz qw";
}

}  // namespace

Trajectory posed_frames(const Reconstruction& reconstruction) {
  Trajectory trajectory;
  for (const PosedFrame& frame : reconstruction.frames) append(frame, &trajectory);
  return trajectory;
}

Trajectory posed_keyframes(const Reconstruction& reconstruction) {
  Trajectory trajectory;
  for (const KeyFrame& keyframe : reconstruction.keyframes) {
    append(reconstruction.frames[keyframe.frame], &trajectory);
  }
  return trajectory;
}

Result<void> prepare_output_folder(const std::filesystem::path& folder) {
  std::error_code failure;
  std::filesystem::create_directories(folder, failure);
  if (!failure && !std::filesystem::is_directory(folder))
    failure = std::make_error_code(std::errc::not_a_directory);
  if (failure) {
    return bad_input(fmt::format("{}: folder cannot be created: {}", folder.string(), failure.message()));
  }
  // Permission bits do not tell: root passes them and a read-only file system does not have them.
  std::string probe = (folder / ".raysfm-XXXXXX").string();
  const int file = ::mkstemp(probe.data());
  if (file < 0) {
    return bad_input(
        fmt::format("{}: files cannot be written to this folder: {}", folder.string(), std::strerror(errno)));
  }
  ::close(file);
  ::unlink(probe.c_str());
  return {};
}

Result<void> write_output_folder(const Reconstruction& reconstruction, const Report& report,
                                 const std::string& config, const std::filesystem::path& folder) {
  Result<void> written = prepare_output_folder(folder);
  if (written) {
    written = write_trajectory(posed_frames(reconstruction),
                               trajectory_header(reconstruction, "every frame with a pose"),
                               folder / "trajectory.txt");
  }
  if (written) {
    written = write_trajectory(posed_keyframes(reconstruction),
                               trajectory_header(reconstruction, "key frames"), folder / "keyframes.txt");
  }
  if (written) written = write_covariance_csv(reconstruction, folder / "covariance.csv");
  if (written) written = write_points_ply(reconstruction, folder / "points.ply");
  if (written) written = write_colmap_model(reconstruction, folder / "sparse");
  if (written) written = write_file(folder / "config.yaml", config);
  if (written) written = write_report(reconstruction, report, folder / "report.json");
  return written;
}

}  // namespace raysfm
