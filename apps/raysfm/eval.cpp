#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <vector>

#include "commands.h"
#include "raysfm/eval/trajectory_error.h"
#include "raysfm/files/atomic_file.h"
#include "raysfm/plots/plot.h"
#include "raysfm/results/trajectory_file.h"
#include "terminal.h"

namespace raysfm::app {
namespace {

using Json = nlohmann::ordered_json;

struct EvalOptions {
  std::string estimate;
  std::string truth;
  std::string align = "sim3";
  double max_dt = EvaluationOptions{}.max_dt;
  bool json = false;
  std::string plot;
};

Alignment alignment_of(const std::string& name) {
  if (name == "sim3") return Alignment::kSim3;
  return name == "se3" ? Alignment::kSe3 : Alignment::kNone;
}

// A world of the estimate, and how it compares.
struct World {
  Trajectory estimate;
  Result<Evaluation> evaluation;
};

Json json_of(const Evaluation& e) {
  Json json;
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

std::string as_json(const std::vector<World>& worlds, double coverage, const EvalOptions& options) {
  Json json = {{"align", options.align}};
  json.update(json_of(*worlds.front().evaluation));
  json["coverage_all"] = coverage;
  json["worlds"] = Json::array();
  for (const auto& [estimate, evaluation] : worlds) {
    Json world = {{"poses", estimate.size()}};
    world.update(evaluation ? json_of(*evaluation) : Json{{"reason", evaluation.error().message}});
    json["worlds"].push_back(std::move(world));
  }
  return json.dump(2) + "\n";
}

std::string table_row(const char* name, const char* unit, const ErrorStatistics& s, double factor = 1) {
  return fmt::format("{:<18}{:>5}{:>12.5g}{:>12.5g}{:>12.5g}{:>12.5g}\n", name, unit, factor * s.rmse,
                     factor * s.mean, factor * s.median, factor * s.max);
}

std::string as_table(const Evaluation& e, const Trajectory& truth, const EvalOptions& options) {
  std::string text =
      fmt::format("alignment         {}, scale {:.6g}\n", options.align, e.truth_from_estimate.scale);
  text += fmt::format("matched           {} of {} poses of the truth, coverage {:.1f} %\n", e.matches.size(),
                      truth.size(), 100 * e.coverage);
  text += fmt::format("path              {:.6g} m\n\n", e.length);
  text += fmt::format("{:<18}{:>5}{:>12}{:>12}{:>12}{:>12}\n", "", "", "rmse", "mean", "median", "max");
  text += table_row("position", "m", e.ate);
  text += table_row("  in the plane", "m", e.ate_horizontal);
  if (e.length > 0) text += table_row("  of the path", "%", e.ate, 100 / e.length);
  text += fmt::format("{:<18}{:>5}{:>12.5g}   between consecutive poses\n", "relative position", "m",
                      e.rpe.trans);
  text += fmt::format("{:<18}{:>5}{:>12.5g}\n", "relative rotation", "deg", e.rpe.rot_deg);
  if (e.kitti) {
    text += fmt::format("KITTI drift       {:.4g} %, {:.4g} deg per 100 m\n", e.kitti->t_rel_percent,
                        e.kitti->r_rel_deg_per_100m);
  } else {
    text += "KITTI drift       none, the path has no stretch of 100 m\n";
  }
  return text;
}

// The other worlds in a line each, which share neither frame nor scale with the main one.
std::string worlds_table(const std::vector<World>& worlds, double coverage) {
  if (worlds.size() == 1) return "";
  std::string text =
      fmt::format("\nThe above is the main of {} worlds that share neither frame nor scale; each alone:\n",
                  worlds.size());
  for (size_t i = 0; i < worlds.size(); ++i) {
    const auto& [estimate, evaluation] = worlds[i];
    text +=
        fmt::format("{:<18}{} poses, ", i == 0 ? "  main" : fmt::format("  worlds/{}", i), estimate.size());
    text += evaluation ? fmt::format("coverage {:.1f} %, scale {:.6g}, rmse {:.5g} m, mean {:.5g} m\n",
                                     100 * evaluation->coverage, evaluation->truth_from_estimate.scale,
                                     evaluation->ate.rmse, evaluation->ate.mean)
                       : evaluation.error().message + "\n";
  }
  return text + fmt::format("  all             coverage {:.1f} %\n", 100 * coverage);
}

Result<std::vector<World>> evaluate_worlds(const EvalOptions& options, const Trajectory& truth) {
  const Result<std::vector<std::filesystem::path>> paths = trajectories_of_worlds(options.estimate);
  if (!paths) return paths.error();
  std::vector<World> worlds;
  for (const std::filesystem::path& path : *paths) {
    Result<Trajectory> estimate = read_trajectory(path);
    if (!estimate) return estimate.error();
    Result<Evaluation> evaluation = evaluate(*estimate, truth, {alignment_of(options.align), options.max_dt});
    worlds.push_back({*std::move(estimate), std::move(evaluation)});
  }
  return worlds;
}

double coverage_of_all(const std::vector<World>& worlds, const Trajectory& truth) {
  std::vector<bool> matched(truth.size(), false);
  for (const World& world : worlds) {
    if (!world.evaluation) continue;
    for (const Match& match : world.evaluation->matches) matched[match.truth] = true;
  }
  return static_cast<double>(std::ranges::count(matched, true)) / truth.size();
}

Result<int> run_eval(const EvalOptions& options, const CommonOptions& common) {
  if (!common.config.empty()) return bad_input("--config is not allowed here, flags are");
  if (!(options.max_dt >= 0) || !std::isfinite(options.max_dt)) {
    return bad_input(fmt::format("--max-dt: {} is not allowed, seconds from 0 are", options.max_dt));
  }
  const std::string inputs[] = {options.estimate, options.truth};
  if (auto r = check_not_input("--plot", options.plot, inputs); !r) return r.error();
  const Result<Trajectory> truth = read_trajectory(options.truth);
  if (!truth) return truth.error();
  const Result<std::vector<World>> worlds = evaluate_worlds(options, *truth);
  if (!worlds) return worlds.error();
  const auto& [estimate, evaluation] = worlds->front();
  if (!evaluation) {
    return bad_input(fmt::format("{}, {}: {}", options.estimate, options.truth, evaluation.error().message));
  }
  if (!options.plot.empty()) {
    const Result<void> plotted = plot_evaluation(estimate, *truth, *evaluation, options.plot);
    if (!plotted) return plotted.error();
  }
  const double coverage = coverage_of_all(*worlds, *truth);
  std::string text;
  if (options.json) {
    text = as_json(*worlds, coverage, options);
  } else if (!common.quiet) {
    text = as_table(*evaluation, *truth, options) + worlds_table(*worlds, coverage);
    if (!options.plot.empty()) text += fmt::format("plot              {}\n", options.plot);
  }
  return printed(text);
}

}  // namespace

Command add_eval(CLI::App& program, const CommonOptions& common) {
  auto options = std::make_shared<EvalOptions>();
  CLI::App* command = program.add_subcommand("eval", "compare a trajectory with the truth");
  command
      ->add_option("ESTIMATE", options->estimate,
                   "trajectory (TUM, EuRoC, or KITTI poses with times.txt beside them) or output folder")
      ->required();
  command->add_option("TRUTH", options->truth, "trajectory, or folder of a sequence")->required();
  command->add_option("--align", options->align, "transform of the estimate that is left free")
      ->check(CLI::IsMember({"sim3", "se3", "none"}))
      ->capture_default_str();
  command->add_option("--max-dt", options->max_dt, "seconds by which matching poses may differ")
      ->capture_default_str();
  command->add_flag("--json", options->json, "print one JSON object");
  command->add_option("--plot", options->plot, "draw the trajectories and the error over time")
      ->type_name("FILE.png");
  return [options, &common] { return run_eval(*options, common); };
}

}  // namespace raysfm::app
