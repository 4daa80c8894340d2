#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <system_error>

#include "raysfm/api/adjust_model.h"
#include "raysfm/files/atomic_file.h"
#include "raysfm/results/output_folder.h"
#include "raysfm/results/ply_file.h"

namespace raysfm {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr const char* kModelFolder = "sparse";

std::string report_text(const AdjustResult& result, const AdjustSettings& settings,
                        const std::string& version, const std::vector<std::string>& files) {
  const bool bal = std::holds_alternative<BalFile>(result.model);
  const AdjustCounts& c = result.counts;
  const BundleSummary& s = result.summary;
  Json json;
  json["version"] = version;
  json["seed"] = settings.seed;
  json["input"] = Json::array({settings.input});
  json["interrupted"] = result.interrupted;
  json["format"] = bal ? "bal" : "colmap";
  json["method"] = settings.method;
  json["loss"] = {{"name", settings.loss}, {"scale_px", settings.loss_scale}};
  json["intrinsics"] = bal ? "refined" : "fixed";
  json["camera_class"] = "central";
  json["error"] = "pixel";
  json["scale"] = "arbitrary";
  json["frames"] = {{"total", c.images}, {"posed", c.images}, {"without_pose", Json::array()}};
  json["keyframes"] = c.images;
  json["cameras"] = c.cameras;
  json["points"] = c.points;
  json["observations"] = c.observations;
  json["used"] = s.used_observations;
  json["dropped"] = s.dropped_observations;
  json["left_out"] = {{"images", c.images_left_out}, {"points", c.points_left_out}};
  json["cost"] = {{"initial", s.initial_cost}, {"final", s.final_cost}};
  json["iterations"] = s.iterations;
  json["termination"] = std::string(to_string(s.termination));
  json["kept_start"] = result.kept_start;
  json["rms_reprojection_px"] = result.final_rms_px;
  json["initial_rms_reprojection_px"] = result.initial_rms_px;
  json["segments"] = Json::array({{{"first", 0}, {"last", c.images - 1}, {"reason", "end of input"}}});
  json["start"] = Json();
  json["timing"] = {{"read_s", result.read_s},
                    {"solve_s", s.solve_ms / 1000.0},
                    {"wall_s", result.wall_s},
                    {"peak_rss_mib", result.peak_rss_mib}};
  json["files"] = files;
  // Names of files need not be UTF-8.
  return json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
}

Reconstruction points_of(const AdjustResult& result) {
  Reconstruction points;
  if (const auto* file = std::get_if<BalFile>(&result.model)) {
    for (const Eigen::Vector3d& position : file->points) points.points.push_back({.position = position});
  } else {
    for (const ColmapPoint& point : std::get<ColmapModel>(result.model).points) {
      points.points.push_back({.position = point.position, .rgb = point.rgb});
    }
  }
  return points;
}

Result<void> write_files(const AdjustResult& result, const AdjustSettings& settings,
                         const std::string& version, const fs::path& folder) {
  const fs::path model = folder / adjusted_name(settings.input);
  const auto* file = std::get_if<BalFile>(&result.model);
  Result<void> written =
      file ? write_bal_file(*file, model) : write_colmap_model(std::get<ColmapModel>(result.model), model);
  if (written) written = write_points_ply(points_of(result), folder / "points.ply");
  if (written) {
    AdjustSettings effective = settings;
    written = write_file(folder / "config.yaml",
                         effective_config(setting_fields(effective), {settings.input}, version));
  }
  if (!written) return written;
  return write_file(folder / "report.json",
                    report_text(result, settings, version, files_with_report(folder)));
}

}  // namespace

fs::path adjusted_name(const fs::path& input) {
  std::error_code ignored;
  if (fs::is_directory(input, ignored)) return kModelFolder;
  fs::path name = input.filename();
  const bool packed = name.extension() == ".bz2";
  if (packed) name = name.stem();
  if (name.extension() == ".txt") name = name.stem();
  name += packed ? ".txt.bz2" : ".txt";
  return name;
}

Result<void> check_adjust_output(const fs::path& input, const fs::path& folder) {
  std::error_code missing;
  const fs::path model = folder / adjusted_name(input);
  const bool same_folder =
      fs::is_directory(input, missing) && fs::equivalent(model_folder(input), model, missing);
  const fs::path written[] = {model, folder / "points.ply", folder / "config.yaml", folder / "report.json"};
  for (const fs::path& path : written) {
    if (!same_folder && !fs::equivalent(path, input, missing)) continue;
    return bad_input(fmt::format("--out: {} would overwrite the input {}", folder.string(), input.string()));
  }
  return {};
}

Result<void> write_adjust_output(const AdjustResult& result, const AdjustSettings& settings,
                                 const std::string& version, const fs::path& folder) {
  return replace_output_folder(
      folder, [&](const fs::path& staged) { return write_files(result, settings, version, staged); });
}

}  // namespace raysfm
