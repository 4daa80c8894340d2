#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <system_error>

#include "raysfm/api/solve.h"
#include "raysfm/io/atomic_file.h"
#include "raysfm/io/colmap_model.h"
#include "raysfm/io/lens_file.h"
#include "raysfm/io/output_folder.h"
#include "raysfm/io/ply_file.h"
#include "raysfm/io/trajectory_file.h"

namespace raysfm {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr const char* kFiles[] = {"trajectory.txt", "points.ply", "lens.csv", "config.yaml", "report.json"};

Trajectory trajectory_of(const SolveResult& result) {
  Trajectory trajectory;
  for (const SolvedFrame& frame : result.frames) {
    if (!frame.cam_from_world) continue;
    trajectory.timestamps.push_back(frame.timestamp);
    trajectory.world_from_cam.push_back(frame.cam_from_world->inverse());
  }
  return trajectory;
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
    without_pose.push_back({{"frame", f}, {"timestamp", frame.timestamp}, {"reason", frame.reason}});
  }
  return {{"total", result.frames.size()}, {"posed", posed}, {"without_pose", without_pose}};
}

std::string report_text(const SolveResult& result, const SolveSettings& settings,
                        const std::string& version) {
  int keyframes = 0;
  for (const SolvedFrame& f : result.frames) keyframes += f.keyframe && f.cam_from_world;
  const LmSummary& lm = result.adjustment.lm;
  Json json;
  json["version"] = version;
  json["seed"] = settings.seed;
  json["input"] = Json::array({settings.input});
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
  json["frames"] = frames_of(result);
  json["keyframes"] = keyframes;
  json["points"] = result.points.size();
  json["observations"] = result.observations.size();
  json["rms_reprojection_px"] = result.rms_px;
  json["cost"] = {{"initial", lm.initial_cost}, {"final", lm.final_cost}};
  json["iterations"] = lm.iterations;
  json["termination"] = std::string(to_string(lm.termination));
  json["segments"] =
      Json::array({{{"first", 0}, {"last", result.frames.size() - 1}, {"reason", "end of input"}}});
  json["start"] = {
      {"method", result.world_is_given ? "known structure" : "fundamental matrix and absolute dual quadric"},
      {"frames", {result.start_frames[0], result.start_frames[1]}},
      {"inliers", result.start_inliers}};
  json["timing"] = {{"read_s", result.read_s},
                    {"solve_s", result.solve_s},
                    {"wall_s", result.wall_s},
                    {"frames_per_second", double(result.frames.size()) / result.wall_s},
                    {"peak_rss_mib", result.peak_rss_mib}};
  // Names of files need not be UTF-8.
  return json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
}

Result<void> write_points(const SolveResult& result, const fs::path& path) {
  Reconstruction points;
  for (const SolvedPoint& p : result.points) points.points.push_back({.position = p.position, .rgb = p.rgb});
  return write_points_ply(points, path);
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
  Result<void> written = prepare_output_folder(folder);
  if (written) {
    written =
        write_trajectory(trajectory_of(result),
                         "every frame with a pose: world from camera; axes x right, y down, z forward; "
                         "Hamilton quaternion\nscale: " +
                             std::string(result.world_is_given ? "of the known structure" : "arbitrary") +
                             "\ntimestamp tx ty tz qx qy qz qw",
                         folder / "trajectory.txt");
  }
  if (written) written = write_points(result, folder / "points.ply");
  if (written) written = write_lens_file(lenses_of(result), folder / "lens.csv");
  if (written) written = write_colmap_model(model_of(result), folder / "sparse");
  if (written) {
    SolveSettings effective = settings;
    written = write_file(folder / "config.yaml",
                         effective_config(setting_fields(effective), {settings.input}, version));
  }
  if (written) written = write_file(folder / "report.json", report_text(result, settings, version));
  return written;
}

}  // namespace raysfm
