#include <fmt/format.h>

#include <cstdio>
#include <filesystem>
#include <memory>

#include "commands.h"
#include "raysfm/api/config.h"
#include "raysfm/api/track.h"
#include "raysfm/io/output_folder.h"
#include "setting_flags.h"
#include "terminal.h"

namespace raysfm::app {
namespace {

struct Arguments {
  TrackSettings settings;
  std::string out;
};

// A line that rewrites itself on a terminal, now and then a plain line elsewhere.
class ProgressPrinter : public ProgressLine {
 public:
  using ProgressLine::ProgressLine;

  void show(const TrackProgress& p) {
    if (quiet() || (!terminal() && p.frames % 100 != 0) || (terminal() && p.frames % 5 != 0)) return;
    const std::string total = p.total >= 0 ? fmt::format("/{}", p.total) : "";
    ProgressLine::show(fmt::format("frame {}{}, {} posed", p.frames, total, p.posed));
  }
};

void print_summary(const TrackResult& result, const std::string& out) {
  const Reconstruction& r = result.reconstruction;
  int posed = 0;
  for (const PosedFrame& f : r.frames) posed += f.world_from_rig.has_value();
  std::printf("%d of %zu frames posed in %zu segment%s, %zu key frames, %zu points, rms %.2f px\n", posed,
              r.frames.size(), r.segments.size(), r.segments.size() == 1 ? "" : "s", r.keyframes.size(),
              r.points.size(), r.rms_reprojection_px);
  std::printf("scale %s, %.1f s, %.1f frames/s, %.0f MiB; written to %s\n",
              r.metric_scale ? "metric" : "arbitrary", result.report.wall_s, result.report.frames_per_second,
              result.report.peak_rss_mib, out.c_str());
}

std::string first_reason(const Reconstruction& r) {
  for (const PosedFrame& f : r.frames) {
    if (!f.reason.empty()) return f.reason;
  }
  return "no frames";
}

// The effective configuration goes to config.yaml, which must not be the camera that is read.
Result<void> prepare_output(const TrackSettings& settings, const std::string& out) {
  std::error_code missing;
  if (std::filesystem::equivalent(std::filesystem::path(out) / "config.yaml", settings.camera, missing)) {
    return bad_input(fmt::format("--out: {} would overwrite the camera file {}", out, settings.camera));
  }
  return prepare_output_folder(out);
}

Result<int> run(Arguments& arguments, const CommonOptions& common) {
  TrackSettings& settings = arguments.settings;
  const StopSignals stop;
  ProgressPrinter printer(common.quiet);
  TrackCallbacks callbacks;
  callbacks.stop = stop.requested();
  callbacks.ready = [&] { return prepare_output(settings, arguments.out); };
  callbacks.progress = [&](const TrackProgress& p) { printer.show(p); };
  callbacks.event = [&](const Event& e) { printer.event(e); };
  Result<TrackResult> result = track(settings, callbacks);
  printer.finish();
  if (!result) return result.error();
  result->report.version = RAYSFM_VERSION;
  if (auto r = write_output_folder(result->reconstruction, result->report,
                                   effective_config(settings, RAYSFM_VERSION), arguments.out);
      !r) {
    return r.error();
  }
  if (!common.quiet) print_summary(*result, arguments.out);
  if (result->interrupted) return stop.exit_code();
  if (result->reconstruction.segments.empty()) return no_reconstruction(first_reason(result->reconstruction));
  return 0;
}

}  // namespace

Command add_track(CLI::App& program, const CommonOptions& common) {
  auto arguments = std::make_shared<Arguments>();
  CLI::App* command = program.add_subcommand("track", "calibrated camera, video to trajectory and map");
  command
      ->add_option("INPUT", arguments->settings.inputs,
                   "video, image folder or pattern, sequence folder, device")
      ->required();
  command->add_option("--out", arguments->out, "folder for the results")->required();
  add_setting_flags(*command, setting_fields(arguments->settings));
  return [arguments, command, &program, &common]() -> Result<int> {
    if (auto r = settle_settings(setting_fields(arguments->settings), *command, program, common); !r) {
      return r.error();
    }
    return run(*arguments, common);
  };
}

}  // namespace raysfm::app
