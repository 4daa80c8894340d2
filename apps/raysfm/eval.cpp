#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <memory>
#include <vector>

#include "commands.h"
#include "raysfm/eval/consistency.h"
#include "raysfm/eval/trajectory_error.h"
#include "raysfm/files/atomic_file.h"
#include "raysfm/plots/plot.h"
#include "raysfm/results/covariance_file.h"
#include "raysfm/results/evaluation_report.h"
#include "raysfm/results/trajectory_file.h"
#include "terminal.h"

namespace raysfm::app {
namespace {

struct EvalOptions {
  std::string estimate;
  std::string truth;
  std::string align = "sim3";
  double max_dt = EvaluationOptions{}.max_dt;
  bool json = false;
  std::string plot;
  std::string covariance;
};

constexpr std::array kWindows = {10, 20, 40};  // frames

Alignment alignment_of(const std::string& name) {
  if (name == "sim3") return Alignment::kSim3;
  return name == "se3" ? Alignment::kSe3 : Alignment::kNone;
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
std::string worlds_table(const EvaluatedWorlds& evaluated) {
  const std::vector<EvaluatedWorld>& worlds = evaluated.worlds;
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
  return text + fmt::format("  all             coverage {:.1f} %\n", 100 * evaluated.coverage);
}

Result<std::vector<WindowConsistency>> judge_covariances(const std::string& path, const Trajectory& estimate,
                                                         const Trajectory& truth,
                                                         const EvaluationOptions& options) {
  const Result<std::vector<Matrix6d>> covariances = read_covariance_csv(path);
  if (!covariances) return covariances.error();
  auto windows = window_consistency(estimate, *covariances, truth, options, kWindows);
  if (!windows) return bad_input(path + ": " + windows.error().message);
  return windows;
}

std::string consistency_row(const char* name, const Consistency& c) {
  return fmt::format("{:<18}{:>5}{:>12.4g}{:>20.4g}\n", name, "%", 100 * c.held, c.normalised_error2);
}

std::string windows_table(std::span<const WindowConsistency> windows) {
  if (windows.empty()) return "";
  std::string text = fmt::format("\n90 % ellipsoids{:>20}{:>20}\n", "hold", "error2 per freedom");
  for (const WindowConsistency& w : windows) {
    if (w.windows == 0) {
      text += fmt::format("none, there are fewer than {} frames\n", w.length);
      continue;
    }
    text += fmt::format("{} windows of {} frames, each aligned by itself\n", w.windows, w.length);
    text += consistency_row("  position", w.position) + consistency_row("  orientation", w.orientation);
  }
  return text;
}

Result<int> run_eval(const EvalOptions& options, const CommonOptions& common) {
  if (!common.config.empty()) return bad_input("--config is not allowed here, flags are");
  if (!(options.max_dt >= 0) || !std::isfinite(options.max_dt)) {
    return bad_input(fmt::format("--max-dt: {} is not allowed, seconds from 0 are", options.max_dt));
  }
  const std::string inputs[] = {options.estimate, options.truth, options.covariance};
  if (auto r = check_not_input("--plot", options.plot, inputs); !r) return r.error();
  const Result<Trajectory> truth = read_trajectory(options.truth);
  if (!truth) return truth.error();
  const Alignment alignment = alignment_of(options.align);
  const Result<EvaluatedWorlds> evaluated =
      evaluate_folder(options.estimate, *truth, options.truth, {alignment, options.max_dt});
  if (!evaluated) return evaluated.error();
  const auto& [estimate, evaluation] = evaluated->worlds.front();
  std::vector<WindowConsistency> windows;
  if (!options.covariance.empty()) {
    auto judged = judge_covariances(options.covariance, estimate, *truth, {alignment, options.max_dt});
    if (!judged) return judged.error();
    windows = *std::move(judged);
  }
  if (!options.plot.empty()) {
    const Result<void> plotted = plot_evaluation(estimate, *truth, *evaluation, options.plot);
    if (!plotted) return plotted.error();
  }
  std::string text;
  if (options.json) {
    text = evaluation_json(*evaluated, alignment, windows);
  } else if (!common.quiet) {
    text = as_table(*evaluation, *truth, options) + worlds_table(*evaluated) + windows_table(windows);
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
  command
      ->add_option(
          "--covariance", options->covariance,
          "covariance.csv of the estimate: how often its ellipsoids hold the errors of short windows")
      ->type_name("FILE.csv");
  command->add_option("--plot", options->plot, "draw the trajectories and the error over time")
      ->type_name("FILE.png");
  return [options, &common] { return run_eval(*options, common); };
}

}  // namespace raysfm::app
