#include "raysfm/results/report_file.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "raysfm/files/atomic_file.h"
#include "raysfm/results/report_cameras.h"
#include "raysfm/results/world_writers.h"
#include "raysfm/scene/worlds.h"

namespace raysfm {
namespace {

using Json = nlohmann::ordered_json;

Json place_held_json(const std::vector<PosedFrame>& frames) {
  Json runs = Json::array();
  for (const FrameRun& run : place_held_runs(frames)) {
    runs.push_back({{"first", run.first}, {"last", run.last}});
  }
  return runs;
}

Json frames_json(const std::vector<PosedFrame>& frames, int in_input) {
  Json without_pose = Json::array();
  for (size_t i = 0; i < frames.size(); ++i) {
    if (frames[i].world_from_rig) continue;
    without_pose.push_back({{"index", i},
                            {"timestamp", frames[i].timestamp},
                            {"image", frames[i].image_name},
                            {"reason", frames[i].reason}});
  }
  const size_t posed = frames.size() - without_pose.size();
  return {{"total", frames.size()},
          {"in_input", in_input >= 0 ? Json(in_input) : Json()},
          {"posed", posed},
          {"without_pose", std::move(without_pose)},
          {"place_held", place_held_json(frames)}};
}

const char* scale_word(bool metric) {
  return metric ? "metric" : "arbitrary";
}

Json percent(const std::optional<double>& part) {
  return part ? Json(100 * *part) : Json();
}

Json number(const std::optional<double>& value) {
  return value ? Json(*value) : Json();
}

Json segments_json(const std::vector<Segment>& segments) {
  Json list = Json::array();
  for (const Segment& s : segments) {
    list.push_back({{"first", s.first},
                    {"last", s.last},
                    {"reason", s.reason},
                    {"scale", scale_word(s.metric_scale)},
                    {"scale_sigma_percent", percent(s.scale_sigma)},
                    {"scale_sigma", number(s.scale_sigma)}});
  }
  return list;
}

Json worlds_json(const Reconstruction& r) {
  std::vector<int> frames(r.segments.size(), 0), keyframes = frames, points = frames;
  for (const PosedFrame& f : r.frames) {
    if (f.world_from_rig && f.segment >= 0) ++frames[f.segment];
  }
  for (const KeyFrame& k : r.keyframes) {
    if (r.frames[k.frame].segment >= 0) ++keyframes[r.frames[k.frame].segment];
  }
  for (const MapPoint& p : r.points) {
    if (p.segment < static_cast<int>(points.size())) ++points[p.segment];
  }
  Json list = Json::array();
  for (const int s : worlds_in_order(r)) {
    list.push_back({{"folder", world_folder(static_cast<int>(list.size())).string()},
                    {"frames", frames[s]},
                    {"keyframes", keyframes[s]},
                    {"points", points[s]},
                    {"segments", {s}},
                    {"scale", scale_word(r.segments[s].metric_scale)},
                    {"scale_sigma_percent", percent(r.segments[s].scale_sigma)}});
  }
  return list;
}

Json starts_json(const std::vector<StartSummary>& starts) {
  Json list = Json::array();
  for (const StartSummary& s : starts) {
    list.push_back({{"method", s.method}, {"frames", s.frames}, {"inliers", s.inliers}});
  }
  return list;
}

Json timing_json(const Report& report) {
  Json timing = Json::object();
  for (const auto& [name, stage] : report.stages) {
    timing[name] = {{"mean_ms", stage.mean_ms()},
                    {"median_ms", stage.median_ms()},
                    {"max_ms", stage.max_ms},
                    {"count", stage.count}};
  }
  if (report.adjustment) {
    timing["read_s"] = report.adjustment->read_s;
    timing["solve_s"] = report.adjustment->solve_s;
  }
  timing["wall_s"] = report.wall_s;
  if (!report.model) timing["frames_per_second"] = report.frames_per_second;
  timing["peak_rss_mib"] = report.peak_rss_mib;
  return timing;
}

Json calibration_json(const std::vector<CalibrationNumber>& numbers) {
  Json list = Json::array();
  for (const CalibrationNumber& n : numbers) {
    list.push_back({{"camera", n.camera},
                    {"name", n.name},
                    {"given", n.given},
                    {"refined", n.refined},
                    {"sigma", n.sigma},
                    {"significance", n.significance},
                    {"told", n.told}});
  }
  return list;
}

Json closures_json(const std::vector<Closure>& closures) {
  Json list = Json::array();
  for (const Closure& c : closures) {
    list.push_back({{"frame", c.frame},
                    {"with_frame", c.with_frame},
                    {"inliers", c.inliers},
                    {"joined_worlds", c.joined_worlds},
                    {"correction", c.correction}});
  }
  return list;
}

const char* command_of(Origin origin) {
  if (origin == Origin::kTrack) return "track";
  return origin == Origin::kSolve ? "solve" : "adjust";
}

Json exif_json(const std::vector<ExifLens>& lenses) {
  Json list = Json::array();
  for (const ExifLens& lens : lenses) {
    Json& json = list.emplace_back();
    json["camera"] = lens.camera;
    json["lens"] = lens.lens;
    json["focal_mm"] = lens.focal_mm > 0 ? Json(lens.focal_mm) : Json();
    json["photos"] = lens.photos;
    json["first_photo"] = lens.first_photo;
    json["focal_px"] = lens.focal_px > 0 ? Json(lens.focal_px) : Json();
    json["focal_sigma_px"] = lens.focal_px > 0 ? Json(lens.focal_sigma_px) : Json();
    json["source"] = lens.source;
    json["not_used"] = lens.not_used.empty() ? Json() : Json(lens.not_used);
  }
  return list;
}

void write_lens(const LensReport& lens, Json* json) {
  (*json)["lens"] = lens.zooming ? "zooming" : "fixed";
  (*json)["lens_evidence"] = lens.evidence;
  (*json)["zoom_undone"] = lens.zoom_undone;
  (*json)["degenerate"] = lens.degenerate.empty() ? Json() : Json(lens.degenerate);
  (*json)["image_size"] = {lens.width, lens.height};
  if (!lens.exif.empty()) (*json)["exif"] = exif_json(lens.exif);
}

void write_lens_origin(const LensOrigin& lens, Json* json) {
  (*json)["lens_source"] = lens.source;
  (*json)["lens_model"] = lens.model.empty() ? Json() : Json(lens.model);
  (*json)["lens_frames"] = lens.first_frame < 0 ? Json() : Json({lens.first_frame, lens.last_frame});
  (*json)["lens_focal_px"] = lens.focal > 0 ? Json(lens.focal) : Json();
  (*json)["lens_focal_sigma_percent"] = lens.focal > 0 ? Json(100 * lens.focal_sigma) : Json();
  (*json)["lens_not_told"] = lens.not_told.empty() ? Json() : Json(lens.not_told);
  (*json)["told_fov_deg"] = lens.told_fov_deg > 0 ? Json(lens.told_fov_deg) : Json();
}

void write_model(const ModelReport& model, Json* json) {
  (*json)["format"] = model.format;
  (*json)["model"] = model.name;
  (*json)["loss"] = {{"name", model.loss}, {"scale_px", model.loss_scale_px}};
  (*json)["intrinsics"] = model.refines_intrinsics ? "refined" : "fixed";
  (*json)["cameras"] = model.cameras;
  (*json)["used"] = model.used_observations;
  (*json)["dropped"] = model.dropped_observations;
  (*json)["left_out"] = {{"images", model.images_left_out}, {"points", model.points_left_out}};
  (*json)["kept_start"] = model.kept_start;
  (*json)["initial_rms_reprojection_px"] = model.initial_rms_px;
}

void write_adjustment(const AdjustmentReport& adjustment, Json* json) {
  (*json)["method"] = adjustment.method;
  (*json)["cost"] = {{"initial", adjustment.initial_cost}, {"final", adjustment.final_cost}};
  (*json)["iterations"] = adjustment.iterations;
  (*json)["termination"] = adjustment.termination;
}

}  // namespace

std::string report_json(const Reconstruction& reconstruction, const Report& report) {
  const Json starts = starts_json(reconstruction.starts);
  Json json;
  json["version"] = report.version;
  json["command"] = command_of(reconstruction.origin);
  json["seed"] = report.seed;
  json["input"] = report.input;
  const TimeRange& range = reconstruction.range;
  if (!range.is_all()) json["range_s"] = {range.from, range.to > 0 ? Json(range.to) : Json()};
  json["interrupted"] = report.interrupted;
  if (reconstruction.origin == Origin::kTrack || !report.warnings.empty()) json["warnings"] = report.warnings;
  if (report.lens) write_lens(*report.lens, &json);
  if (report.lens_origin) write_lens_origin(*report.lens_origin, &json);
  if (report.model) write_model(*report.model, &json);
  if (report.adjustment) write_adjustment(*report.adjustment, &json);
  json["camera_class"] = report.camera_class;
  json["error"] = report.error;
  json["scale"] = scale_word(reconstruction.metric_scale);
  json["scale_sigma_percent"] = percent(reconstruction.scale_sigma);
  json["scale_sigma"] = number(reconstruction.scale_sigma);
  json["frames"] = frames_json(reconstruction.frames, report.frames_in_input);
  json["keyframes"] = reconstruction.keyframes.size();
  json["points"] = reconstruction.points.size();
  json["observations"] = reconstruction.observations.size();
  json["rms_reprojection_px"] = reconstruction.rms_reprojection_px;
  json["worlds"] = worlds_json(reconstruction);
  json["closures"] = closures_json(reconstruction.closures);
  json["segments"] = segments_json(reconstruction.segments);
  json["start"] = starts.empty() ? Json() : starts.front();
  json["starts"] = starts;
  if (reconstruction.origin == Origin::kTrack) {
    write_rig_json(reconstruction.rig, &json);
    json["calibration"] = calibration_json(reconstruction.calibration);
  }
  if (reconstruction.origin == Origin::kSolve) write_lenses_json(reconstruction, &json);
  json["timing"] = timing_json(report);
  json["files"] = report.files;
  // Names of files need not be UTF-8.
  return json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
}

Result<void> write_report(const Reconstruction& reconstruction, const Report& report,
                          const std::filesystem::path& path) {
  return write_file(path, report_json(reconstruction, report));
}

}  // namespace raysfm
