#include "raysfm/results/evaluation_report.h"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <utility>

#include "raysfm/results/trajectory_file.h"

namespace raysfm {
namespace {

using EvaluationJson = nlohmann::ordered_json;

EvaluationJson json_of(const Evaluation& e) {
  EvaluationJson json;
  json["scale"] = e.truth_from_estimate.scale;
  json["matched"] = e.matches.size();
  json["coverage"] = e.coverage;
  json["length_m"] = e.length;
  json["ate"] = {{"rmse", e.ate.rmse}, {"mean", e.ate.mean}, {"median", e.ate.median}, {"max", e.ate.max}};
  json["ate_xy"] = {{"mean", e.ate_horizontal.mean}};
  json["rpe"] = {{"trans", e.rpe.trans}, {"rot_deg", e.rpe.rot_deg}};
  json["kitti"] = {{"t_rel_percent", nullptr}, {"r_rel_deg_per_100m", nullptr}};
  if (e.kitti) {
    json["kitti"]["t_rel_percent"] = e.kitti->t_rel_percent;
    json["kitti"]["r_rel_deg_per_100m"] = e.kitti->r_rel_deg_per_100m;
  }
  return json;
}

EvaluationJson json_of(const Consistency& c) {
  return {{"held", c.held}, {"normalised_error2", c.normalised_error2}};
}

// Null where there is no window of that length.
EvaluationJson json_of(std::span<const WindowConsistency> windows) {
  EvaluationJson json = EvaluationJson::array();
  for (const WindowConsistency& w : windows) {
    EvaluationJson& entry = json.emplace_back();
    entry = {{"length", w.length}, {"windows", w.windows}, {"frames", w.frames}};
    entry["position"] = w.windows > 0 ? json_of(w.position) : EvaluationJson(nullptr);
    entry["orientation"] = w.windows > 0 ? json_of(w.orientation) : EvaluationJson(nullptr);
  }
  return json;
}

double coverage_of_all(const std::vector<EvaluatedWorld>& worlds, const Trajectory& truth) {
  std::vector<bool> matched(truth.size(), false);
  for (const EvaluatedWorld& world : worlds) {
    if (!world.evaluation) continue;
    for (const Match& match : world.evaluation->matches) matched[match.truth] = true;
  }
  return static_cast<double>(std::ranges::count(matched, true)) / truth.size();
}

}  // namespace

Result<EvaluatedWorlds> evaluate_worlds(std::vector<Trajectory> worlds, const Trajectory& truth,
                                        const EvaluationOptions& options) {
  EvaluatedWorlds evaluated;
  for (Trajectory& estimate : worlds) {
    Result<Evaluation> evaluation = evaluate(estimate, truth, options);
    if (!evaluation && evaluated.worlds.empty()) return evaluation.error();
    evaluated.worlds.push_back({std::move(estimate), std::move(evaluation)});
  }
  if (evaluated.worlds.empty()) return bad_input("no poses");
  evaluated.coverage = coverage_of_all(evaluated.worlds, truth);
  return evaluated;
}

Result<EvaluatedWorlds> evaluate_folder(const std::filesystem::path& path, const Trajectory& truth,
                                        const std::string& truth_path, const EvaluationOptions& options) {
  const Result<std::vector<std::filesystem::path>> paths = trajectories_of_worlds(path);
  if (!paths) return paths.error();
  std::vector<Trajectory> worlds;
  for (const std::filesystem::path& world : *paths) {
    Result<Trajectory> estimate = read_trajectory(world);
    if (!estimate) return estimate.error();
    worlds.push_back(*std::move(estimate));
  }
  Result<EvaluatedWorlds> evaluated = evaluate_worlds(std::move(worlds), truth, options);
  if (evaluated) return evaluated;
  return bad_input(fmt::format("{}, {}: {}", path.string(), truth_path, evaluated.error().message));
}

std::string evaluation_json(const EvaluatedWorlds& evaluated, Alignment alignment,
                            std::span<const WindowConsistency> windows) {
  EvaluationJson json = {{"align", alignment_name(alignment)}};
  json.update(json_of(*evaluated.worlds.front().evaluation));
  json["coverage_all"] = evaluated.coverage;
  json["worlds"] = EvaluationJson::array();
  for (const auto& [estimate, evaluation] : evaluated.worlds) {
    EvaluationJson world = {{"poses", estimate.size()}};
    world.update(evaluation ? json_of(*evaluation) : EvaluationJson{{"reason", evaluation.error().message}});
    json["worlds"].push_back(std::move(world));
  }
  if (!windows.empty()) json["covariance"] = json_of(windows);
  return json.dump(2) + "\n";
}

}  // namespace raysfm
