#include <fmt/format.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "commands.h"
#include "live_view.h"
#include "raysfm/api/track.h"
#include "raysfm/settings/config.h"
#include "setting_flags.h"
#include "terminal.h"

namespace raysfm::app {
namespace {

struct TrackArguments {
  TrackSettings settings;
  std::string out;
  bool resume = false;
  ViewFlag view;
};

// Beside the output folder, which is replaced as a whole.
std::string checkpoint_of(const std::string& out) {
  std::filesystem::path folder = std::filesystem::absolute(out).lexically_normal();
  if (!folder.has_filename()) folder = folder.parent_path();
  return (folder.parent_path() / ("." + folder.filename().string() + ".checkpoint")).string();
}

// A line that rewrites itself on a terminal, now and then a plain line elsewhere.
class TrackPrinter : public ProgressLine {
 public:
  using ProgressLine::ProgressLine;

  void show(const TrackProgress& p) {
    if (quiet() || (!terminal() && p.frames % 100 != 0) || (terminal() && p.frames % 5 != 0)) return;
    const std::string total = p.total >= 0 ? fmt::format("/{}", p.total) : "";
    ProgressLine::show(fmt::format("frame {}{}, {} posed", p.frames, total, p.posed));
  }
};

void print_track_summary(const TrackResult& result, const std::string& out) {
  const Reconstruction& r = result.reconstruction;
  std::printf("%s\n", counts_text(r).c_str());
  if (r.segments.size() > 1) {
    std::printf("segments share neither world nor scale: the longest is at the top, the others in worlds/\n");
  }
  const auto held = std::ranges::count_if(r.frames, &PosedFrame::place_held);
  if (held > 0) {
    std::printf("%td of them were only seen to turn: their place is not known, and taken to stay\n", held);
  }
  std::printf("scale %s, %.1f s, %.1f frames/s, %.0f MiB; written to %s\n",
              r.metric_scale ? "metric" : "arbitrary", result.report.wall_s, result.report.frames_per_second,
              result.report.peak_rss_mib, out.c_str());
}

// The exit code of a run that has written its result, or why there was none to write.
Result<int> outcome(const TrackResult& result, bool written, const std::string& out,
                    const StopSignals& stop) {
  if (result.report.interrupted) return stop.exit_code();
  if (!result.reconstruction.segments.empty()) return 0;
  return why_no_pose(result, written, out);
}

void print_track_progress(const TrackProgress& p, LiveView* view, TrackPrinter* printer) {
  printer->show(p);
  if (view)
    view->say(fmt::format("frame {}{}, {} posed", p.frames,
                          p.total >= 0 ? fmt::format(" of {}", p.total) : "", p.posed));
}

Result<int> run_track(TrackArguments& arguments, const CommonOptions& common) {
  TrackSettings& settings = arguments.settings;
  if (arguments.resume) {
    settings.checkpoint = checkpoint_of(arguments.out);
    settings.program_version = RAYSFM_VERSION;
  }
  const StopSignals stop;
  TrackPrinter printer(common.quiet);
  Result<std::unique_ptr<LiveView>> view = arguments.view.start(settings.inputs);
  if (!view) return view.error();
  if (*view) printer.line("to be watched at " + (*view)->url());
  TrackCallbacks callbacks;
  callbacks.stop = stop.requested();
  callbacks.ready = [&] { return prepare_track_output(settings, arguments.out); };
  callbacks.progress = [&](const TrackProgress& p) { print_track_progress(p, view->get(), &printer); };
  callbacks.event = [&](const Event& e) { printer.event(e); };
  const Result<TrackResult> result = track(settings, callbacks, view->get());
  printer.finish();
  if (!result) return result.error();
  const Result<bool> written = write_track_output(*result, settings, RAYSFM_VERSION, arguments.out);
  if (!written) return written.error();
  std::error_code failure;  // an interrupted run is gone on from
  if (arguments.resume && !result->report.interrupted) {
    std::filesystem::remove(settings.checkpoint, failure);
  }
  if (!common.quiet && *written) print_track_summary(*result, arguments.out);
  if (*view) (*view)->finish(result->reconstruction, result->report);
  return outcome(*result, *written, arguments.out, stop);
}

}  // namespace

Command add_track(CLI::App& program, const CommonOptions& common) {
  auto arguments = std::make_shared<TrackArguments>();
  CLI::App* command = program.add_subcommand("track", "calibrated camera, video to trajectory and map");
  command
      ->add_option("INPUT", arguments->settings.inputs,
                   "video, image folder or pattern, sequence folder, device")
      ->check(named());
  command->add_option("--out", arguments->out, "folder for the results")->required()->check(named());
  command->add_flag(
      "--resume", arguments->resume,
      "leaves checkpoints, and goes on from that of a run that was killed, with the same results");
  arguments->view.add_to(command);
  add_setting_flags(*command, setting_fields(arguments->settings));
  return [arguments, command, &program, &common]() -> Result<int> {
    const Result<ConfigRecord> config = settle_settings(setting_fields(arguments->settings), *command,
                                                        program, common, &arguments->settings.inputs);
    if (!config) return config.error();
    Result<int> code = run_track(*arguments, common);
    if (!code) return where_it_was_set(code.error(), *config);
    return code;
  };
}

}  // namespace raysfm::app
