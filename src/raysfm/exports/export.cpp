#include "raysfm/exports/export.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>

#include "raysfm/camera_files/camera_file.h"
#include "raysfm/exports/mesh_export.h"
#include "raysfm/exports/path_formats.h"
#include "raysfm/exports/pinhole_images.h"
#include "raysfm/exports/scene_formats.h"
#include "raysfm/exports/undistort.h"
#include "raysfm/files/atomic_file.h"
#include "raysfm/files/staged_folder.h"
#include "raysfm/files/text_file.h"
#include "raysfm/results/output_folder.h"
#include "raysfm/results/reconstruction_folder.h"
#include "raysfm/results/report_cameras.h"
#include "raysfm/results/report_fault.h"
#include "raysfm/results/report_file.h"
#include "raysfm/scene/worlds.h"

namespace raysfm {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr const char* kManifest = "export.json";
constexpr std::string_view kFormats[] = {"colmap", "nerfstudio", "blender", "bundler", "ply",
                                         "tum",    "kitti",      "euroc",   "mesh"};

// Formats of images with cameras, and what they hold.
struct SceneFormat {
  std::string_view name;
  Result<void> (*holds)(const Camera& camera);
};
constexpr SceneFormat kSceneFormats[] = {{"colmap", colmap_holds},
                                         {"nerfstudio", nerfstudio_holds},
                                         {"blender", blender_holds},
                                         {"bundler", bundler_holds}};

const SceneFormat* scene_format(std::string_view name) {
  const auto* found = std::ranges::find(kSceneFormats, name, &SceneFormat::name);
  return found == std::end(kSceneFormats) ? nullptr : found;
}

std::string formats_that_hold(const Camera& camera) {
  std::vector<std::string_view> names;
  for (const SceneFormat& format : kSceneFormats) {
    if (format.holds(camera)) names.push_back(format.name);
  }
  return names.empty() ? "" : fmt::format("--format {} can, or ", fmt::join(names, " or "));
}

Result<void> check_cameras(const SceneFormat& format, const ExportScene& scene) {
  for (size_t c = 0; c < scene.cameras.size(); ++c) {
    const Camera& camera = scene.cameras[c];
    const Result<void> held = format.holds(camera);
    if (held) continue;
    const std::string who =
        camera.name.empty() ? fmt::format("lens {}", c) : fmt::format("camera '{}'", camera.name);
    return bad_input(fmt::format("{} ({}): {} cannot hold it, {}; {}--undistort makes pinholes", who,
                                 model_name(camera.model), format.name, held.error().message,
                                 formats_that_hold(camera)));
  }
  return {};
}

// A camera file for results that do not tell their cameras: the given one, or the refined one beside them.
Result<Rig> camera_file(const ExportSettings& settings) {
  if (!settings.camera.empty()) return read_camera_file(settings.camera);
  const fs::path refined = settings.result / "camera.yaml";
  std::error_code missing;
  return fs::is_regular_file(refined, missing) ? read_camera_file(refined) : Rig{};
}

// Models from the file; names and places that the report tells: those of the file may be as before
// refinement.
Result<void> complete_rig(const ExportSettings& settings, const Rig& file, Reconstruction* r) {
  if (r->origin != Origin::kTrack || !r->rig.cameras.empty()) return {};
  if (file.cameras.empty()) {
    return bad_input(
        fmt::format("{}: the result does not tell its cameras, since COLMAP has none like them; "
                    "give their file with --camera",
                    settings.result.string()));
  }
  const fs::path path = settings.result / "report.json";
  const Result<std::string> text = read_text_file(path, kMaxReportBytes);
  if (!text) return text.error();
  r->rig = file;
  try {
    const Json report = Json::parse(*text);
    const size_t cameras = report.at("rig").size();
    if (cameras > file.cameras.size()) {
      return bad_input(fmt::format("--camera: {} cameras are not enough, the result has {}",
                                   file.cameras.size(), cameras));
    }
    r->rig.cameras.resize(cameras);
    for (size_t c = 0; c < cameras; ++c) {
      const Json& size = report.at("rig").at(c).at("resolution");
      Camera& camera = r->rig.cameras[c];
      if (camera.width == 0) camera.width = size.at(0), camera.height = size.at(1);
      if (camera.width == size.at(0) && camera.height == size.at(1)) continue;
      return bad_input(
          fmt::format("--camera: camera {} of {} x {} pixels is not allowed, the result has {} x {}", c,
                      camera.width, camera.height, size.at(0).get<int>(), size.at(1).get<int>()));
    }
    read_rig_json(report, &r->rig);
  } catch (const Json::exception& e) {
    return report_fault(path, *text, e);
  }
  return {};
}

// One world; frames of others stay, without their poses, so that all keep their numbers.
Reconstruction only_world(Reconstruction whole, int segment) {
  Reconstruction world = world_of(whole, segment);
  std::vector<int> numbers;
  for (size_t f = 0; f < whole.frames.size(); ++f) {
    PosedFrame& frame = whole.frames[f];
    if (!frame.world_from_rig) continue;
    if (frame.segment == segment) {
      numbers.push_back(static_cast<int>(f));
    } else {
      frame.world_from_rig.reset();
      frame.reason = "in another world";
    }
  }
  for (KeyFrame& keyframe : world.keyframes) keyframe.frame = numbers[keyframe.frame];
  world.frames = std::move(whole.frames);
  return world;
}

// Beside the result, since what lies in its folder is in the way of the next one.
fs::path default_out(const ExportSettings& settings) {
  std::error_code failure;
  fs::path folder = fs::canonical(settings.result, failure);
  if (failure) folder = settings.result;
  return folder.string() + "-" + settings.format;
}

Result<Reconstruction> read_world(const ExportSettings& settings, const Rig& file, ExportSummary* summary) {
  Result<Reconstruction> whole = read_reconstruction(settings.result);
  if (!whole) return whole;
  const std::vector<int> worlds = worlds_in_order(*whole);
  if (worlds.empty()) {
    return bad_input(fmt::format("{}: no frame of this result has a pose", settings.result.string()));
  }
  if (settings.world < 0 || settings.world >= static_cast<int>(worlds.size())) {
    return bad_input(
        fmt::format("--world: {} is not allowed, 0 to {} are", settings.world, worlds.size() - 1));
  }
  if (worlds.size() > 1) {
    summary->notes.push_back(
        fmt::format("this is world {} of {}; --world tells which", settings.world, worlds.size()));
  }
  if (auto complete = complete_rig(settings, file, &*whole); !complete) return complete.error();
  // All frames stay, so that they keep their numbers.
  return only_world(*std::move(whole), worlds[settings.world]);
}

// Largest shift in the image that a skew makes; pixels.
double largest_skew(const ExportScene& scene) {
  double largest = 0;
  for (size_t c = 0; c < scene.cameras.size(); ++c) {
    const std::optional<Lens> lens = lens_of(scene.cameras[c]);
    if (lens) largest = std::max(largest, std::abs(scene.skews[c]) * scene.cameras[c].height / 2 / lens->fy);
  }
  return largest;
}

Result<void> write_scene(const ExportSettings& settings, const Reconstruction& world,
                         const ExportScene& scene, const fs::path& folder) {
  if (settings.format == "colmap") return write_colmap(scene, settings.text, folder);
  if (settings.format == "nerfstudio") return write_nerfstudio(scene, folder);
  if (settings.format == "blender") return write_blender(world, scene, folder);
  return write_bundler(scene, folder);
}

Result<void> export_scene(const ExportSettings& settings, const Rig& file, const Reconstruction& world,
                          const fs::path& folder, ExportSummary* summary) {
  constexpr double kVisible = 0.01;  // pixels
  const bool animated = settings.format == "blender" && settings.images.empty();
  Result<ExportScene> scene = make_export_scene(world, settings.all_frames || animated);
  if (!scene) return scene.error();
  if (!settings.images.empty()) name_as_png(&*scene);
  std::optional<UndistortedScene> pinholes;
  if (settings.undistort) {
    Result<UndistortedScene> made = undistort(*scene);
    if (!made) return made.error();
    pinholes = *std::move(made);
  }
  const ExportScene& written = pinholes ? pinholes->scene : *scene;
  if (auto held = check_cameras(*scene_format(settings.format), written); !held) return held;
  if (const double skew = largest_skew(written); skew > kVisible) {
    summary->notes.push_back(fmt::format(
        "a skew of up to {:.2g} px at the rim is left out, which no such format has; --undistort keeps it",
        skew));
  }
  if (auto done = write_scene(settings, world, written, folder); !done) return done;
  summary->images = static_cast<int>(written.images.size());
  if (settings.images.empty()) return {};
  return write_images({settings.images, file, settings.threads}, world, *scene,
                      pinholes ? &*pinholes : nullptr, folder / "images");
}

// Without --images the input of the run is tried, which may be gone.
Result<void> export_mesh(const ExportSettings& settings, const Rig& file, const Reconstruction& world,
                         const fs::path& folder, const ExportProgress& progress, ExportSummary* summary) {
  const Result<ExportScene> scene = make_export_scene(world, false);
  if (!scene) return scene.error();
  MeshImages images = {{settings.images, file, settings.threads}, settings.texture_side};
  images.must_be_there = !settings.images.empty();
  if (settings.images.empty() && world.origin != Origin::kAdjust)
    images.input.paths = inputs_of_result(settings.result);
  const Result<MeshSummary> written = write_mesh(world, *scene, images, folder, progress);
  if (!written) return written.error();
  summary->faces = written->faces;
  if (!written->note.empty()) summary->notes.push_back(written->note);
  return {};
}

Result<void> write_all(const ExportSettings& settings, const Rig& file, const Reconstruction& world,
                       const fs::path& folder, const ExportProgress& progress, ExportSummary* summary) {
  Result<void> written;
  if (settings.format == "ply") {
    written = write_ply(world, folder);
  } else if (settings.format == "tum") {
    written = write_tum(world, folder);
  } else if (settings.format == "kitti") {
    written = write_kitti(world, folder);
  } else if (settings.format == "euroc") {
    written = write_euroc(world, folder);
  } else if (settings.format == "mesh") {
    written = export_mesh(settings, file, world, folder, progress, summary);
  } else {
    written = export_scene(settings, file, world, folder, summary);
  }
  if (!written) return written;
  Json manifest = {
      {"format", settings.format}, {"world", settings.world}, {"undistorted", settings.undistort}};
  std::vector<std::string> files = files_below(folder);
  files.emplace_back(kManifest);
  manifest["files"] = files;
  return write_file(folder / kManifest, manifest.dump(1, ' ', false, Json::error_handler_t::replace) + "\n");
}

// What an older export left in the folder.
std::vector<std::string> older_files(const fs::path& folder) {
  const Result<std::string> text = read_text_file(folder / kManifest, kMaxReportBytes);
  const Json manifest = text ? Json::parse(*text, nullptr, false) : Json();
  std::vector<std::string> files;
  if (!manifest.is_object() || !manifest.contains("format")) return files;
  for (const Json& name : manifest.value("files", Json::array())) {
    if (name.is_string() && stays_below(name.get<std::string>())) files.push_back(name);
  }
  return files;
}

Result<void> check_settings(const ExportSettings& settings) {
  if (std::ranges::find(kFormats, settings.format) == std::end(kFormats)) {
    return bad_input(
        fmt::format("--format: {} is not allowed, {} are", settings.format, fmt::join(kFormats, ", ")));
  }
  const bool scene = scene_format(settings.format) != nullptr, mesh = settings.format == "mesh";
  constexpr int kLeastSide = 64, kMostSide = 16384;
  if (settings.texture_side < kLeastSide || settings.texture_side > kMostSide) {
    return bad_input(fmt::format("--texture-side: {} is not allowed, {} to {} are", settings.texture_side,
                                 kLeastSide, kMostSide));
  }
  if (settings.text && settings.format != "colmap")
    return bad_input("--text: only --format colmap has a text form");
  if (mesh && (settings.undistort || settings.all_frames)) {
    return bad_input(
        "--format mesh: has no images of its own, so that --undistort and --all-frames are not allowed");
  }
  if (!scene && !mesh && (settings.undistort || settings.all_frames || !settings.images.empty())) {
    return bad_input(
        fmt::format("--format {}: has no images, so that --undistort, --images and --all-frames are not "
                    "allowed with it",
                    settings.format));
  }
  if (settings.all_frames && settings.images.empty()) {
    return bad_input(
        "--all-frames: results keep the names of key frames' images alone; --images tells the others");
  }
  return {};
}

// No file of a result, or of somebody's data, is replaced.
Result<void> check_place(const fs::path& out) {
  std::error_code missing;
  if (!fs::exists(out / "report.json", missing)) return {};
  return bad_input(fmt::format("--out: {} is not allowed, it is the folder of a result", out.string()));
}

}  // namespace

std::span<const std::string_view> export_formats() {
  return kFormats;
}

Result<ExportSummary> export_result(const ExportSettings& settings, const ExportProgress& progress) {
  if (auto good = check_settings(settings); !good) return good.error();
  ExportSummary summary;
  summary.out = settings.out.empty() ? default_out(settings) : settings.out;
  if (auto good = check_place(summary.out); !good) return good.error();
  const Result<Rig> file = camera_file(settings);
  if (!file) return file.error();
  const Result<Reconstruction> world = read_world(settings, *file, &summary);
  if (!world) return world.error();
  summary.frames = posed_count(*world);
  summary.points = static_cast<int>(world->points.size());
  std::error_code failure;
  const bool there = fs::exists(summary.out, failure);
  Result<StagedFolder> staged = StagedFolder::create(summary.out);
  if (!staged) return staged.error();
  Result<void> written = write_all(settings, *file, *world, staged->path(), progress, &summary);
  if (written) written = staged->commit(older_files(summary.out), kManifest);
  if (written) return summary;
  if (!there) fs::remove(summary.out, failure);
  return staged->in_place(written.error());
}

}  // namespace raysfm
