#include "raysfm/api/solve.h"

#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "commands.h"
#include "live_view.h"
#include "raysfm/results/output_folder.h"
#include "raysfm/scene/worlds.h"
#include "setting_flags.h"
#include "terminal.h"

namespace raysfm::app {
namespace {

struct SolveArguments {
  SolveSettings settings;
  std::string out;
  ViewFlag view;
};

std::string stage_text(const char* stage, int done, int total) {
  return std::string(stage) + " " + std::to_string(done) + (total >= 0 ? "/" + std::to_string(total) : "");
}

// A line that rewrites itself on a terminal, now and then a plain line elsewhere.
class SolvePrinter : public ProgressLine {
 public:
  using ProgressLine::ProgressLine;

  void show(const char* stage, int done, int total) {
    if (quiet() || (!terminal() && done % 100 != 0)) return;
    ProgressLine::show(stage_text(stage, done, total));
  }
};

// Of the middle one of the frames with a pose.
const FrameLens* middle_lens(const Reconstruction& r) {
  std::vector<int> lenses;
  for (const PosedFrame& frame : r.frames) {
    if (frame.lens >= 0) lenses.push_back(frame.lens);
  }
  return lenses.empty() ? nullptr : &r.lenses[lenses[lenses.size() / 2]];
}

void print_lens(const FrameLens& lens) {
  std::printf("focal length %.1f px, standard deviation %.2g px, in the middle of the video\n",
              lens_of(lens)->fx, lens.sigma[0]);
  const RadialDistortion radial = radial_distortion_of(lens.camera);
  if (radial.none()) return;
  std::printf("radial distortion k1 %.4f, standard deviation %.2g\n", radial.k1, lens.radial_sigma.k1);
}

void print_solve_summary(const SolveResult& result, const std::string& out) {
  const Reconstruction& r = result.reconstruction;
  std::printf("%d of %zu frames posed, %zu points, rms %.2f px\n", posed_count(r), r.frames.size(),
              r.points.size(), r.rms_reprojection_px);
  if (const size_t worlds = worlds_in_order(r).size(); worlds > 1) {
    std::printf(
        "%zu worlds that share neither frame nor scale: the largest is at the top, the others in worlds/\n",
        worlds);
  }
  if (const auto& lens = result.report.lens)
    std::printf("lens %s: %s\n", lens->zooming ? "zooming" : "fixed", lens->evidence.c_str());
  if (const FrameLens* middle = middle_lens(r)) print_lens(*middle);
  std::printf("%.1f s, %.0f MiB; written to %s\n", result.report.wall_s, result.report.peak_rss_mib,
              out.c_str());
}

Result<int> run_solve(const SolveArguments& arguments, const CommonOptions& common) {
  const SolveSettings& settings = arguments.settings;
  const StopSignals stop;
  SolvePrinter printer(common.quiet);
  Result<std::unique_ptr<LiveView>> view = arguments.view.start({settings.input});
  if (!view) return view.error();
  if (*view) printer.line("to be watched at " + (*view)->url());
  SolveCallbacks callbacks;
  callbacks.stop = stop.requested();
  callbacks.ready = [&]() -> Result<void> {
    if (auto r = check_solve_output(settings.input, arguments.out); !r) return r;
    return prepare_output_folder(arguments.out);
  };
  callbacks.event = [&](const Event& e) { printer.event(e); };
  callbacks.progress = [&](const char* stage, int done, int total) {
    printer.show(stage, done, total);
    if (*view) (*view)->say(stage_text(stage, done, total));
  };
  const Result<SolveResult> result = solve(settings, callbacks);
  printer.finish();
  if (!result && stop.requested()->load()) {
    printer.line("interrupted before there was anything to write");
    return stop.exit_code();
  }
  if (!result) return result.error();
  if (auto r = write_solve_output(*result, settings, RAYSFM_VERSION, arguments.out); !r) return r.error();
  if (!common.quiet) print_solve_summary(*result, arguments.out);
  if (*view) (*view)->finish(result->reconstruction, result->report);
  return result->report.interrupted ? stop.exit_code() : 0;
}

}  // namespace

Command add_solve(CLI::App& program, const CommonOptions& common) {
  auto arguments = std::make_shared<SolveArguments>();
  CLI::App* command =
      program.add_subcommand("solve", "unknown or zooming lens: poses, map and lenses from images alone");
  command
      ->add_option("INPUT", arguments->settings.input,
                   "video, image folder or pattern, sequence folder, or CSV of point tracks: image,point,u,v")
      ->check(named());
  command->add_option("--out", arguments->out, "folder for the results")->required()->check(named());
  arguments->view.add_to(command);
  add_setting_flags(*command, setting_fields(arguments->settings));
  return [arguments, command, &program, &common]() -> Result<int> {
    const Result<ConfigRecord> config = settle_settings(setting_fields(arguments->settings), *command,
                                                        program, common, &arguments->settings.input);
    if (!config) return config.error();
    Result<int> code = run_solve(*arguments, common);
    if (!code) return where_it_was_set(code.error(), *config);
    return code;
  };
}

}  // namespace raysfm::app
