#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <system_error>

#include "raysfm/api/solve.h"
#include "raysfm/colmap_bal/colmap_model.h"
#include "raysfm/files/atomic_file.h"
#include "raysfm/plots/lens_plot.h"
#include "raysfm/results/covariance_file.h"
#include "raysfm/results/lens_file.h"
#include "raysfm/results/output_folder.h"
#include "raysfm/results/ply_file.h"
#include "raysfm/results/trajectory_file.h"

namespace raysfm {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr const char* kFiles[] = {"trajectory.txt", "keyframes.txt", "covariance.csv", "points.ply",
                                  "lens.csv",       "lens.png",      "config.yaml",    "report.json"};

// What the writers of any reconstruction take.
Reconstruction reconstruction_of(const SolveResult& result) {
  Reconstruction r;
  r.metric_scale = result.world_is_given;
  for (size_t f = 0; f < result.frames.size(); ++f) {
    const SolvedFrame& frame = result.frames[f];
    PosedFrame& posed = r.frames.emplace_back();
    posed.timestamp = frame.timestamp;
    posed.covariance = frame.covariance;
    if (frame.cam_from_world) posed.world_from_rig = frame.cam_from_world->inverse();
    if (frame.cam_from_world && frame.keyframe) r.keyframes.push_back({.frame = static_cast<int>(f)});
  }
  for (const SolvedPoint& p : result.points) r.points.push_back({.position = p.position, .rgb = p.rgb});
  return r;
}

std::vector<LensOfFrame> lenses_of(const SolveResult& result) {
  std::vector<LensOfFrame> lenses;
  for (const SolvedFrame& frame : result.frames) {
    if (!frame.cam_from_world) continue;
    LensOfFrame& lens = lenses.emplace_back();
    lens.timestamp = frame.timestamp;
    const LensVector value = frame.lens.vector();
    for (int i = 0; i < 5; ++i) {
      lens.value[i] = value[i];
      lens.sigma[i] = frame.lens_sigma[i];
    }
  }
  return lenses;
}

// COLMAP counts pixels from the corner of the first one and knows no skew.
ColmapCamera camera_of(const SolveResult& result, const SolvedFrame& frame, uint32_t id) {
  const Lens& lens = frame.lens;
  if (!result.radial.none()) {
    return {.id = id,
            .model = find_colmap_model("RADIAL")->id,
            .width = static_cast<uint64_t>(frame.width),
            .height = static_cast<uint64_t>(frame.height),
            .parameters = {lens.fx, lens.cx + 0.5, lens.cy + 0.5, result.radial.k1, result.radial.k2}};
  }
  const ColmapCameraModel* pinhole = find_colmap_model("PINHOLE");
  return {.id = id,
          .model = pinhole->id,
          .width = static_cast<uint64_t>(frame.width),
          .height = static_cast<uint64_t>(frame.height),
          .parameters = {lens.fx, lens.fy, lens.cx + 0.5, lens.cy + 0.5}};
}

// Key frames with a pose, with one camera for each where the lens zooms or the sizes differ.
void add_images(const SolveResult& result, ColmapModel* model) {
  const bool alike = std::ranges::all_of(result.frames, [&](const SolvedFrame& frame) {
    return frame.width == result.width && frame.height == result.height;
  });
  size_t next = 0;
  for (size_t f = 0; f < result.frames.size(); ++f) {
    const SolvedFrame& frame = result.frames[f];
    const size_t first = next;
    while (next < result.observations.size() && result.observations[next].frame == static_cast<int>(f)) {
      const SolvedObservation& o = result.observations[next++];
      model->keypoints.push_back({o.pixel.x() + 0.5, o.pixel.y() + 0.5, static_cast<uint64_t>(o.point) + 1});
    }
    if (!frame.keyframe || !frame.cam_from_world) continue;
    if (result.zooming || !alike || model->cameras.empty()) {
      model->cameras.push_back(camera_of(result, frame, static_cast<uint32_t>(model->cameras.size() + 1)));
    }
    const Eigen::Quaterniond& q = frame.cam_from_world->rotation;
    const Eigen::Vector3d& t = frame.cam_from_world->translation;
    model->images.push_back({.id = static_cast<uint32_t>(model->images.size() + 1),
                             .rotation = {q.w(), q.x(), q.y(), q.z()},
                             .translation = {t.x(), t.y(), t.z()},
                             .camera_id = model->cameras.back().id,
                             .name = frame.image_name,
                             .first_keypoint = first,
                             .last_keypoint = next,
                             .camera = static_cast<int>(model->cameras.size() - 1)});
  }
}

void add_points(const SolveResult& result, ColmapModel* model) {
  std::vector<std::vector<ColmapTrackElement>> tracks(result.points.size());
  for (size_t j = 0; j < model->images.size(); ++j) {
    const ColmapImage& image = model->images[j];
    for (size_t k = image.first_keypoint; k < image.last_keypoint; ++k) {
      tracks[model->keypoints[k].point_id - 1].push_back(
          {image.id, static_cast<uint32_t>(k - image.first_keypoint), static_cast<int>(j)});
    }
  }
  for (size_t i = 0; i < result.points.size(); ++i) {
    ColmapPoint& point = model->points.emplace_back();
    point.id = i + 1;
    point.position = result.points[i].position;
    point.rgb = result.points[i].rgb;
    point.first_element = model->elements.size();
    model->elements.insert(model->elements.end(), tracks[i].begin(), tracks[i].end());
    point.last_element = model->elements.size();
  }
}

ColmapModel model_of(const SolveResult& result) {
  ColmapModel model;
  add_images(result, &model);
  add_points(result, &model);
  return model;
}

Json frames_of(const SolveResult& result) {
  Json without_pose = Json::array();
  int posed = 0;
  for (size_t f = 0; f < result.frames.size(); ++f) {
    const SolvedFrame& frame = result.frames[f];
    posed += frame.cam_from_world.has_value();
    if (frame.cam_from_world) continue;
    without_pose.push_back({{"index", f},
                            {"timestamp", frame.timestamp},
                            {"image", frame.image_name},
                            {"reason", frame.reason}});
  }
  return {{"total", result.frames.size()}, {"posed", posed}, {"without_pose", without_pose}};
}

// One world: from the first pose to the last.
Json segments_of(const SolveResult& result) {
  int first = -1, last = -1;
  for (int f = 0; f < static_cast<int>(result.frames.size()); ++f) {
    if (!result.frames[f].cam_from_world) continue;
    if (first < 0) first = f;
    last = f;
  }
  if (first < 0) return Json::array();
  const bool to_the_end = last + 1 == static_cast<int>(result.frames.size());
  const char* const end = result.interrupted ? "interrupted" : "end of input";
  const std::string reason = to_the_end ? end : result.frames[last + 1].reason;
  return Json::array({{{"first", first}, {"last", last}, {"reason", reason}}});
}

// The only one, from what the report says of it.
Json worlds_of(const Json& report) {
  return Json::array({{{"folder", "."},
                       {"frames", report["frames"]["posed"]},
                       {"keyframes", report["keyframes"]},
                       {"points", report["points"]},
                       {"segments", {0}},
                       {"scale", report["scale"]},
                       {"scale_sigma_percent", Json()}}});
}

Json timing_of(const SolveResult& result) {
  Json timing = Json::object();
  for (const auto& [name, stage] : result.stages) {
    timing[name] = {{"mean_ms", stage.mean_ms()},
                    {"median_ms", stage.median_ms()},
                    {"max_ms", stage.max_ms},
                    {"count", stage.count}};
  }
  timing["read_s"] = result.read_s;
  timing["solve_s"] = result.solve_s;
  timing["wall_s"] = result.wall_s;
  timing["frames_per_second"] = double(result.frames.size()) / result.wall_s;
  timing["peak_rss_mib"] = result.peak_rss_mib;
  return timing;
}

std::string report_text(const SolveResult& result, const SolveSettings& settings, const std::string& version,
                        const std::vector<std::string>& files) {
  int keyframes = 0;
  for (const SolvedFrame& f : result.frames) keyframes += f.keyframe && f.cam_from_world;
  const LmSummary& lm = result.adjustment.lm;
  Json json;
  json["version"] = version;
  json["seed"] = settings.seed;
  json["input"] = Json::array({settings.input});
  json["interrupted"] = result.interrupted;
  json["method"] = settings.method;
  json["lens"] = result.zooming ? "zooming" : "fixed";
  json["lens_evidence"] = result.lens_evidence;
  json["degenerate"] = result.degenerate.empty() ? Json() : Json(result.degenerate);
  json["image_size"] = {result.width, result.height};
  json["camera_class"] = "central";
  json["error"] = "pixel";
  json["distortion"] = result.radial.none() ? Json()
                                            : Json{{"k1", result.radial.k1},
                                                   {"k2", result.radial.k2},
                                                   {"k1_sigma", result.radial_sigma.k1},
                                                   {"k2_sigma", result.radial_sigma.k2}};
  json["scale"] = result.world_is_given ? "metric" : "arbitrary";
  json["scale_sigma_percent"] = Json();
  json["frames"] = frames_of(result);
  json["keyframes"] = keyframes;
  json["points"] = result.points.size();
  json["observations"] = result.observations.size();
  json["rms_reprojection_px"] = result.rms_px;
  json["cost"] = {{"initial", lm.initial_cost}, {"final", lm.final_cost}};
  json["iterations"] = lm.iterations;
  json["termination"] = std::string(to_string(lm.termination));
  json["worlds"] = worlds_of(json);
  json["closures"] = Json::array();
  json["segments"] = segments_of(result);
  json["start"] = {
      {"method", result.world_is_given ? "known structure" : "fundamental matrix and absolute dual quadric"},
      {"frames", {result.start_frames[0], result.start_frames[1]}},
      {"inliers", result.start_inliers}};
  json["timing"] = timing_of(result);
  json["files"] = files;
  // Names of files need not be UTF-8.
  return json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
}

std::string trajectory_header(const SolveResult& result, const char* what) {
  return fmt::format(
      "{}: world from camera; axes x right, y down, z forward; Hamilton quaternion\n"
      "scale: {}\ntimestamp tx ty tz qx qy qz qw",
      what, result.world_is_given ? "of the known structure" : "arbitrary");
}

Result<void> write_lenses(const SolveResult& result, const fs::path& folder) {
  const std::vector<LensOfFrame> lenses = lenses_of(result);
  Result<void> written = write_lens_file(lenses, folder / "lens.csv");
  if (written && !lenses.empty()) written = plot_lens(lenses, folder / "lens.png");
  return written;
}

Result<void> write_files(const SolveResult& result, const SolveSettings& settings, const std::string& version,
                         const fs::path& folder) {
  const Reconstruction reconstruction = reconstruction_of(result);
  Result<void> written =
      write_trajectory(posed_frames(reconstruction), trajectory_header(result, "every frame with a pose"),
                       folder / "trajectory.txt");
  if (written) {
    written = write_trajectory(posed_keyframes(reconstruction), trajectory_header(result, "key frames"),
                               folder / "keyframes.txt");
  }
  if (written) written = write_covariance_csv(reconstruction, folder / "covariance.csv");
  if (written) written = write_points_ply(reconstruction, folder / "points.ply");
  if (written) written = write_lenses(result, folder);
  if (written) written = write_colmap_model(model_of(result), folder / "sparse");
  if (written) {
    SolveSettings effective = settings;
    written = write_file(folder / "config.yaml",
                         effective_config(setting_fields(effective), {settings.input}, version));
  }
  if (!written) return written;
  return write_file(folder / "report.json",
                    report_text(result, settings, version, files_with_report(folder)));
}

}  // namespace

Result<void> check_solve_output(const fs::path& input, const fs::path& folder) {
  for (const char* name : kFiles) {
    std::error_code missing;
    if (!fs::equivalent(folder / name, input, missing) &&
        !fs::equivalent(folder / name, input / name, missing))
      continue;
    return bad_input(
        fmt::format("--out: {} would overwrite {} of the input {}", folder.string(), name, input.string()));
  }
  return {};
}

Result<void> write_solve_output(const SolveResult& result, const SolveSettings& settings,
                                const std::string& version, const fs::path& folder) {
  return replace_output_folder(
      folder, [&](const fs::path& staged) { return write_files(result, settings, version, staged); });
}

}  // namespace raysfm
