#include "raysfm/results/reconstruction_folder.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "raysfm/camera_files/camera_file.h"
#include "raysfm/colmap_bal/bal_file.h"
#include "raysfm/colmap_bal/colmap_model.h"
#include "raysfm/colmap_bal/model_reconstruction.h"
#include "raysfm/files/text_file.h"
#include "raysfm/results/covariance_file.h"
#include "raysfm/results/observations_file.h"
#include "raysfm/results/ply_file.h"
#include "raysfm/results/report_cameras.h"
#include "raysfm/results/report_fault.h"
#include "raysfm/results/report_file.h"
#include "raysfm/results/trajectory_file.h"

namespace raysfm {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

std::optional<double> number_or_none(const Json& number) {
  return number.is_null() ? std::nullopt : std::optional<double>(number.get<double>());
}

Origin origin_of(const Json& report) {
  const std::string command = report.at("command");
  if (command == "track") return Origin::kTrack;
  return command == "solve" ? Origin::kSolve : Origin::kAdjust;
}

void read_report(const Json& report, Reconstruction* r) {
  r->origin = origin_of(report);
  r->metric_scale = report.at("scale") == "metric";
  r->scale_sigma = number_or_none(report.at("scale_sigma"));
  r->rms_reprojection_px = report.at("rms_reprojection_px");
  if (report.contains("range_s")) {
    r->range = {report["range_s"].at(0), number_or_none(report["range_s"].at(1)).value_or(0)};
  }
  r->segments.clear();
  for (const Json& s : report.at("segments")) {
    r->segments.push_back({s.at("first"), s.at("last"), s.at("reason"), s.at("scale") == "metric",
                           number_or_none(s.at("scale_sigma"))});
  }
  for (const Json& s : report.at("starts")) {
    r->starts.push_back({s.at("method"), s.at("frames"), s.at("inliers")});
  }
}

// Reports of version 0.1.0 have none.
void read_calibration(const Json& report, Reconstruction* r) {
  if (!report.contains("calibration")) return;
  for (const Json& n : report.at("calibration")) {
    r->calibration.push_back({n.at("camera"), n.at("name"), n.at("given"), n.at("refined"), n.at("sigma"),
                              n.at("significance"), n.at("told")});
  }
}

// Likewise.
void read_closures(const Json& report, Reconstruction* r) {
  if (!report.contains("closures")) return;
  for (const Json& c : report.at("closures")) {
    r->closures.push_back(
        {c.at("frame"), c.at("with_frame"), c.at("inliers"), c.at("joined_worlds"), c.at("correction")});
  }
}

// Frames with a pose lie between those without, of which the report has the numbers.
void place_frames(const Json& frames, std::vector<PosedFrame> posed, Reconstruction* r) {
  std::map<size_t, PosedFrame> without;
  for (const Json& f : frames.at("without_pose")) {
    PosedFrame& frame = without[f.at("index")];
    frame.timestamp = f.at("timestamp");
    frame.image_name = f.at("image");
    frame.reason = f.at("reason");
  }
  std::ranges::stable_sort(posed, {}, &PosedFrame::timestamp);
  auto next = posed.begin();
  while (next != posed.end() || without.contains(r->frames.size())) {
    const auto missing = without.find(r->frames.size());
    r->frames.push_back(missing != without.end() ? std::move(missing->second) : std::move(*next++));
  }
}

// Likewise of what older reports lack.
void hold_places(const Json& frames, Reconstruction* r) {
  if (!frames.contains("place_held")) return;
  for (const Json& run : frames.at("place_held")) {
    for (size_t i = run.at("first"); i <= run.at("last") && i < r->frames.size(); ++i) {
      r->frames[i].place_held = r->frames[i].world_from_rig.has_value();
    }
  }
}

Result<void> read_frames(const fs::path& folder, int segment, std::vector<PosedFrame>* frames) {
  const Result<Trajectory> trajectory = read_trajectory(folder / "trajectory.txt");
  if (!trajectory) return trajectory.error();
  const Result<std::vector<Matrix6d>> covariances = read_covariance_csv(folder / "covariance.csv");
  if (!covariances) return covariances.error();
  if (static_cast<int>(covariances->size()) != trajectory->size()) {
    return bad_input(fmt::format("{}: {} lines, trajectory.txt has {}", (folder / "covariance.csv").string(),
                                 covariances->size(), trajectory->size()));
  }
  for (int i = 0; i < trajectory->size(); ++i) {
    PosedFrame& frame = frames->emplace_back();
    frame.timestamp = trajectory->timestamps[i];
    frame.segment = segment;
    frame.world_from_rig = trajectory->world_from_cam[i];
    frame.covariance = (*covariances)[i];
  }
  return {};
}

// Frames of the key frames in a world, by their timestamps.
Result<std::vector<int>> keyframes_in(const fs::path& folder, const Reconstruction& r) {
  const Result<Trajectory> keyframes = read_trajectory(folder / "keyframes.txt");
  if (!keyframes) return keyframes.error();
  std::vector<int> frames;
  for (const double timestamp : keyframes->timestamps) {
    const auto frame = std::ranges::lower_bound(r.frames, timestamp, {}, &PosedFrame::timestamp);
    if (frame == r.frames.end() || frame->timestamp != timestamp) {
      return bad_input(fmt::format("{}: {} is not in trajectory.txt", (folder / "keyframes.txt").string(),
                                   timestamp_text(timestamp)));
    }
    frames.push_back(static_cast<int>(frame - r.frames.begin()));
  }
  return frames;
}

// The cameras of a rig but for their names and places.
Result<void> read_rig(const ColmapModel& model, Rig* rig) {
  for (const ColmapCamera& colmap : model.cameras) {
    Result<CameraModel> converted = camera_model_from_colmap(colmap.model, colmap.parameters);
    if (!converted) return converted.error();
    Camera& camera = rig->cameras.emplace_back();
    camera.model = *std::move(converted);
    camera.width = static_cast<int>(colmap.width);
    camera.height = static_cast<int>(colmap.height);
  }
  return {};
}

// Images of a key frame in sparse/.
size_t cameras_of_frame(const Reconstruction& r, const ColmapModel& model) {
  return r.origin == Origin::kSolve ? 1 : model.cameras.size();
}

// The same of cameras that COLMAP lacks, from the camera file in the folder; none where that is not theirs.
void read_models(const fs::path& folder, const Json& report, Rig* rig) {
  const fs::path path = folder / "camera.yaml";
  std::error_code missing;
  if (!report.contains("rig") || !fs::is_regular_file(path, missing)) return;
  const Result<Rig> file = read_camera_file(path);
  const Json& told = report["rig"];
  if (!file || file->cameras.size() < told.size()) return;
  std::vector<Camera> cameras;
  for (size_t c = 0; c < told.size(); ++c) {
    const Camera& camera = cameras.emplace_back(file->cameras[c]);
    const Json& size = told[c].at("resolution");
    if (model_name(camera.model) != told[c].at("model") || camera.width != size.at(0) ||
        camera.height != size.at(1)) {
      return;
    }
  }
  rig->cameras = std::move(cameras);
}

void read_observations(const ColmapModel& model, const std::vector<int>& frames, int first_point,
                       Reconstruction* r) {
  const size_t cameras = cameras_of_frame(*r, model);
  for (size_t k = 0; k < frames.size(); ++k) {
    KeyFrame keyframe{frames[k], static_cast<int>(r->observations.size()), 0};
    for (size_t i = k * cameras; i < (k + 1) * cameras; ++i) {
      const ColmapImage& image = model.images[i];
      r->frames[frames[k]].image_name =
          cameras == 1 ? image.name : image.name.substr(image.name.find('/') + 1);
      for (size_t p = image.first_keypoint; p < image.last_keypoint; ++p) {
        const ColmapKeypoint& seen = model.keypoints[p];
        r->observations.push_back({first_point + static_cast<int>(seen.point_id) - 1,
                                   static_cast<int>(i - k * cameras),
                                   {seen.x - kColmapPixelOrigin, seen.y - kColmapPixelOrigin}});
      }
    }
    keyframe.last_observation = static_cast<int>(r->observations.size());
    r->keyframes.push_back(keyframe);
  }
}

Result<void> read_map(const fs::path& folder, int segment, Reconstruction* r) {
  const Result<std::vector<int>> frames = keyframes_in(folder, *r);
  if (!frames) return frames.error();
  const Result<std::vector<MapPoint>> points = read_points_ply(folder / "points.ply");
  if (!points) return points.error();
  const int first = static_cast<int>(r->points.size());
  for (const MapPoint& point : *points) {
    r->points.push_back(point);
    r->points.back().segment = segment;
  }
  if (!is_colmap_model(folder / "sparse")) {
    for (const int frame : *frames) r->keyframes.push_back({.frame = frame});
    // Results of version 0.1.0 have none.
    const fs::path observations = folder / "observations.csv";
    std::error_code missing;
    if (r->origin != Origin::kTrack || !fs::is_regular_file(observations, missing)) return {};
    return read_observations_csv(observations, static_cast<int>(frames->size()), first, r);
  }
  const Result<ColmapModel> model = read_colmap_model(folder / "sparse");
  if (!model) return model.error();
  const auto fits = [&](const ColmapPoint& p) { return p.id >= 1 && p.id <= points->size(); };
  if (model->images.size() != frames->size() * cameras_of_frame(*r, *model) ||
      !std::ranges::all_of(model->points, fits)) {
    return bad_input(
        fmt::format("{}: does not fit to keyframes.txt and points.ply", (folder / "sparse").string()));
  }
  for (const ColmapPoint& p : model->points) r->points[first + p.id - 1].position = p.position;
  if (r->origin == Origin::kTrack && r->rig.cameras.empty()) {
    if (auto rig = read_rig(*model, &r->rig); !rig) return rig;
  }
  read_observations(*model, *frames, first, r);
  return {};
}

// The adjusted model, in the form that it was given in.
Result<Reconstruction> read_model(const fs::path& folder, const Json& report) {
  const fs::path path = folder / fs::path(report.at("model").get<std::string>()).filename();
  if (report.at("format") == "bal") {
    const Result<BalFile> file = read_bal_file(path);
    return file ? Result<Reconstruction>(reconstruction_of(*file)) : file.error();
  }
  const Result<ColmapModel> model = read_colmap_model(path);
  return model ? Result<Reconstruction>(reconstruction_of(*model)) : model.error();
}

Result<Reconstruction> read_worlds(const fs::path& folder, const Json& report) {
  Reconstruction r;
  read_report(report, &r);
  std::map<int, fs::path> worlds;  // by segment
  for (const Json& world : report.at("worlds")) {
    worlds[world.at("segments").at(0)] = folder / world.at("folder").get<std::string>();
  }
  std::vector<PosedFrame> posed;
  for (const auto& [segment, path] : worlds) {
    if (auto read = read_frames(path, segment, &posed); !read) return read.error();
  }
  place_frames(report.at("frames"), std::move(posed), &r);
  hold_places(report.at("frames"), &r);
  if (r.origin == Origin::kSolve) read_lenses_json(report, &r);
  for (const auto& [segment, path] : worlds) {
    if (auto read = read_map(path, segment, &r); !read) return read.error();
  }
  if (r.origin == Origin::kTrack) {
    if (r.rig.cameras.empty()) read_models(folder, report, &r.rig);
    read_rig_json(report, &r.rig);
    read_calibration(report, &r);
    read_closures(report, &r);
  }
  return r;
}

Result<Reconstruction> read_all(const fs::path& folder, const Json& report) {
  if (origin_of(report) != Origin::kAdjust) return read_worlds(folder, report);
  Result<Reconstruction> r = read_model(folder, report);
  if (r) read_report(report, &*r);
  return r;
}

}  // namespace

Result<Reconstruction> read_reconstruction(const fs::path& folder) {
  std::error_code failure;
  if (fs::exists(folder, failure) && !fs::is_directory(folder, failure)) {
    return bad_input(
        fmt::format("{}: not a folder; that of a result of track, solve or adjust is one", folder.string()));
  }
  const fs::path path = folder / "report.json";
  if (!fs::exists(path, failure)) {
    return bad_input(
        fmt::format("{}: no such file; a result of track, solve or adjust has one", path.string()));
  }
  const Result<std::string> text = read_text_file(path, kMaxReportBytes);
  if (!text) return text.error();
  try {
    return read_all(folder, Json::parse(*text));
  } catch (const Json::exception& e) {
    return report_fault(path, *text, e);
  }
}

std::vector<std::string> inputs_of_result(const fs::path& folder) {
  const Result<std::string> text = read_text_file(folder / "report.json", kMaxReportBytes);
  const Json report = text ? Json::parse(*text, nullptr, false) : Json();
  std::vector<std::string> inputs;
  if (!report.is_object() || !report.contains("input")) return inputs;
  for (const Json& input : report["input"]) {
    if (input.is_string()) inputs.push_back(input);
  }
  return inputs;
}

}  // namespace raysfm
