#include <fmt/format.h>

#include <algorithm>
#include <string>
#include <vector>

#include "raysfm/api/solve_result.h"
#include "raysfm/api/track.h"
#include "raysfm/camera_files/camera_file.h"
#include "raysfm/camera_files/colmap_camera.h"
#include "raysfm/core/paged_memory.h"
#include "raysfm/files/atomic_file.h"
#include "raysfm/results/output_folder.h"
#include "raysfm/settings/config.h"

namespace raysfm {
namespace {

// Bytes of a map, and of what adjusts it, that are in memory before a file is made for more of it, and of
// that file.
constexpr size_t kInMemory = size_t{64} << 20, kResident = size_t{64} << 20;

// What a camera file should say of a lens that no file told; empty of one that a file told.
std::string origin_comment(const TrackResult& result) {
  const std::optional<LensOrigin>& origin = result.report.lens_origin;
  if (!origin || origin->source == "camera file") return "";
  std::string text = fmt::format("# From the {}", origin->source);
  if (origin->first_frame >= 0) {
    text += fmt::format(", frames {} to {}", origin->first_frame, origin->last_frame);
  }
  text += fmt::format(", where fx was {:.6g} with a standard deviation of {:.2g} %.\n", origin->focal,
                      100 * origin->focal_sigma);
  for (const CalibrationNumber& n : result.reconstruction.calibration) {
    text += fmt::format("# {}: standard deviation {:.3g}{}\n", n.name, n.sigma,
                        n.refined != n.given ? ", refined" : "");
  }
  return text;
}

// Whether sparse/ tells the cameras.
bool colmap_has(const Rig& rig) {
  return std::ranges::all_of(rig.cameras, [](const Camera& c) { return colmap_camera(c.model).has_value(); });
}

// What tells the lenses of frames that have their own, else the camera file: as refined or found, or as given
// where nothing else in the result tells it. The first has another name where the given one lies in the same
// folder.
std::vector<ResultFile> lens_files(const TrackResult& result, const TrackSettings& settings,
                                   const std::filesystem::path& out) {
  const Reconstruction& r = result.reconstruction;
  if (r.origin == Origin::kSolve) return lens_plot(r);
  const auto is_refined = [](const CalibrationNumber& n) { return n.refined != n.given; };
  const std::string comment = origin_comment(result);
  const bool is_given = comment.empty() && std::ranges::none_of(r.calibration, is_refined);
  if (is_given && colmap_has(r.rig)) return {};
  std::vector<std::string> given = {settings.camera};
  for (const std::string& input : settings.inputs) given.push_back(input + "/camera.yaml");
  const Result<void> is_free = check_not_input("--out", out / "camera.yaml", given);
  if (is_given && !is_free) return {};
  return {{is_free ? "camera.yaml" : "camera-refined.yaml", [&r, comment](const auto& path) {
             return write_file(path, comment + format_camera_file(r.rig));
           }}};
}

std::string first_reason(const Reconstruction& r) {
  for (const PosedFrame& f : r.frames) {
    if (!f.reason.empty()) return f.reason;
  }
  return "no frames";
}

}  // namespace

Result<void> prepare_track_output(const TrackSettings& settings, const std::filesystem::path& folder) {
  std::vector<std::string> inputs = settings.inputs;
  inputs.push_back(settings.camera);
  if (auto r = check_output_folder(folder, inputs); !r) return r;
  if (auto r = prepare_output_folder(folder); !r) return r;
  page_beyond(kInMemory, folder, kResident);
  return {};
}

Result<bool> write_track_output(const TrackResult& result, const TrackSettings& settings,
                                const std::string& version, const std::filesystem::path& folder) {
  Report report = result.report;
  report.version = version;
  return write_output_folder(result.reconstruction, std::move(report), effective_config(settings, version),
                             folder, lens_files(result, settings, folder));
}

Error why_no_pose(const TrackResult& result, bool written, const std::filesystem::path& folder) {
  const std::string reason = first_reason(result.reconstruction);
  if (written) return no_reconstruction(reason);
  return no_reconstruction(fmt::format(
      "{}; the older result in {} stays, failed.json has the report of this run", reason, folder.string()));
}

}  // namespace raysfm
