#include <fmt/format.h>

#include <cmath>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>

#include "commands.h"
#include "raysfm/eval/trajectory_error.h"
#include "raysfm/io/atomic_file.h"
#include "raysfm/io/plot.h"
#include "raysfm/io/trajectory_file.h"

namespace raysfm::app {
namespace {

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

std::string as_json(const Evaluation& e, const EvalOptions& options) {
  nlohmann::ordered_json json;
  json["align"] = options.align;
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

Result<int> run_eval(const EvalOptions& options, const CommonOptions& common) {
  if (!common.config.empty()) return bad_input("--config is not allowed here, flags are");
  if (!(options.max_dt >= 0) || !std::isfinite(options.max_dt)) {
    return bad_input(fmt::format("--max-dt: {} is not allowed, seconds from 0 are", options.max_dt));
  }
  const std::string inputs[] = {options.estimate, options.truth};
  if (auto r = check_not_input("--plot", options.plot, inputs); !r) return r.error();
  const Result<Trajectory> estimate = read_trajectory(options.estimate);
  if (!estimate) return estimate.error();
  const Result<Trajectory> truth = read_trajectory(options.truth);
  if (!truth) return truth.error();
  const Result<Evaluation> evaluation =
      evaluate(*estimate, *truth, {alignment_of(options.align), options.max_dt});
  if (!evaluation) {
    return bad_input(fmt::format("{}, {}: {}", options.estimate, options.truth, evaluation.error().message));
  }
  if (!options.plot.empty()) {
    if (const auto plotted = plot_evaluation(*estimate, *truth, *evaluation, options.plot); !plotted) {
      return plotted.error();
    }
  }
  std::string text;
  if (options.json) {
    text = as_json(*evaluation, options);
  } else if (!common.quiet) {
    text = as_table(*evaluation, *truth, options);
    if (!options.plot.empty()) text += fmt::format("plot              {}\n", options.plot);
  }
  if (std::fputs(text.c_str(), stdout) < 0 || std::fflush(stdout) != 0) {
    return bad_input("standard output cannot be written");
  }
  return 0;
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
