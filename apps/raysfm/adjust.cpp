#include "raysfm/adjustment/adjust.h"

#include <fmt/format.h>

#include <cstdio>
#include <memory>

#include "commands.h"
#include "raysfm/core/timer.h"
#include "raysfm/results/output_folder.h"
#include "setting_flags.h"
#include "terminal.h"

namespace raysfm::app {
namespace {

struct AdjustArguments {
  AdjustSettings settings;
  std::string out;
};

// A line that rewrites itself on a terminal, a plain line every other second elsewhere.
class AdjustPrinter : public ProgressLine {
 public:
  using ProgressLine::ProgressLine;

  void show(const IterationInfo& info) {
    ++iterations_;
    const double pause_ms = terminal() ? 50 : 2000;
    if (quiet() || (iterations_ > 1 && milliseconds_since(shown_) < pause_ms)) return;
    shown_ = Clock::now();
    ProgressLine::show(fmt::format("iteration {}, cost {:.6g}", iterations_, info.cost));
  }

 private:
  int iterations_ = 0;
  Clock::time_point shown_;
};

void print_adjust_summary(const AdjustResult& result, const std::string& out) {
  const Reconstruction& r = result.reconstruction;
  const ModelReport& m = *result.report.model;
  const AdjustmentReport& a = *result.report.adjustment;
  std::printf("%zu images, %zu points, %d observations, %d dropped\n", r.frames.size() - m.images_left_out,
              r.points.size() - m.points_left_out, m.used_observations, m.dropped_observations);
  std::printf("cost %.6e to %.6e, rms %.4g to %.4g px, %d iterations, %s\n", a.initial_cost, a.final_cost,
              m.initial_rms_px, r.rms_reprojection_px, a.iterations, a.termination.c_str());
  std::printf("%.2f s, %.0f MiB; written to %s\n", a.solve_s, result.report.peak_rss_mib, out.c_str());
}

Result<int> run_adjust(const AdjustArguments& arguments, const CommonOptions& common) {
  const AdjustSettings& settings = arguments.settings;
  const StopSignals stop;
  AdjustPrinter printer(common.quiet);
  AdjustCallbacks callbacks;
  callbacks.stop = stop.requested();
  callbacks.ready = [&]() -> Result<void> {
    if (auto r = check_adjust_output(settings.input, arguments.out); !r) return r;
    return prepare_output_folder(arguments.out);
  };
  callbacks.progress = [&](const IterationInfo& info) { printer.show(info); };
  callbacks.event = [&](const Event& e) { printer.event(e); };
  const Result<AdjustResult> result = adjust(settings, callbacks);
  printer.finish();
  if (!result) return result.error();
  if (auto r = write_adjust_output(*result, settings, RAYSFM_VERSION, arguments.out); !r) return r.error();
  if (!common.quiet) print_adjust_summary(*result, arguments.out);
  return result->report.interrupted ? stop.exit_code() : 0;
}

}  // namespace

Command add_adjust(CLI::App& program, const CommonOptions& common) {
  auto arguments = std::make_shared<AdjustArguments>();
  CLI::App* command = program.add_subcommand("adjust", "bundle adjustment of a BAL file or a COLMAP model");
  command->footer(
      "A BAL camera's f, k1 and k2 are refined with its pose; the intrinsics of a COLMAP model stay as they "
      "are.");
  command
      ->add_option("INPUT", arguments->settings.input,
                   "BAL file, plain or .bz2, or folder of a COLMAP model, binary or text")
      ->check(named());
  command->add_option("--out", arguments->out, "folder for the results")->required()->check(named());
  add_setting_flags(*command, setting_fields(arguments->settings));
  return [arguments, command, &program, &common]() -> Result<int> {
    const Result<ConfigRecord> config = settle_settings(setting_fields(arguments->settings), *command,
                                                        program, common, &arguments->settings.input);
    if (!config) return config.error();
    Result<int> code = run_adjust(*arguments, common);
    if (!code) return where_it_was_set(code.error(), *config);
    return code;
  };
}

}  // namespace raysfm::app
