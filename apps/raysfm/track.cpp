#include <fmt/format.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "commands.h"
#include "raysfm/api/config.h"
#include "raysfm/api/track.h"
#include "raysfm/camera_files/camera_file.h"
#include "raysfm/files/atomic_file.h"
#include "raysfm/results/output_folder.h"
#include "raysfm/scene/worlds.h"
#include "setting_flags.h"
#include "terminal.h"

namespace raysfm::app {
namespace {

struct Arguments {
  TrackSettings settings;
  std::string out;
  bool resume = false;
};

// Beside the output folder, which is replaced as a whole.
std::string checkpoint_of(const std::string& out) {
  std::filesystem::path folder = std::filesystem::absolute(out).lexically_normal();
  if (!folder.has_filename()) folder = folder.parent_path();
  return (folder.parent_path() / ("." + folder.filename().string() + ".checkpoint")).string();
}

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
  std::printf("%d of %zu frames posed in %zu segment%s, %zu key frames, %zu points, rms %.2f px\n",
              posed_count(r), r.frames.size(), r.segments.size(), r.segments.size() == 1 ? "" : "s",
              r.keyframes.size(), r.points.size(), r.rms_reprojection_px);
  if (r.segments.size() > 1) {
    std::printf("segments share neither world nor scale: the longest is at the top, the others in worlds/\n");
  }
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

Result<void> prepare_output(const TrackSettings& settings, const std::string& out) {
  std::vector<std::string> inputs = settings.inputs;
  inputs.push_back(settings.camera);
  if (auto r = check_output_folder(out, inputs); !r) return r;
  return prepare_output_folder(out);
}

// What a camera file should say of a lens that no file told; empty of one that a file told.
std::string origin_comment(const TrackResult& result) {
  const std::optional<LensOrigin>& origin = result.report.lens_origin;
  if (!origin || origin->source == "camera file") return "";
  std::string text = fmt::format("# From the {}", origin->source);
  if (origin->first_frame >= 0) {
    text += fmt::format(", frames {} to {}", origin->first_frame, origin->last_frame);
  }
  text += fmt::format(", where fx was {:.6g} with a standard deviation of {:.2g} %.\n", origin->focal,
                      100 * origin->focal_sigma);
  for (const CalibrationNumber& n : result.reconstruction.calibration) {
    text += fmt::format("# {}: standard deviation {:.3g}{}\n", n.name, n.sigma,
                        n.refined != n.given ? ", refined" : "");
  }
  return text;
}

// The camera file as refined or found: of another name where the given one lies in the same folder.
std::vector<ResultFile> found_camera(const TrackResult& result, const TrackSettings& settings,
                                     const std::string& out) {
  const Reconstruction& r = result.reconstruction;
  const auto is_refined = [](const CalibrationNumber& n) { return n.refined != n.given; };
  const std::string comment = origin_comment(result);
  if (comment.empty() && std::ranges::none_of(r.calibration, is_refined)) return {};
  std::vector<std::string> given = {settings.camera};
  for (const std::string& input : settings.inputs) given.push_back(input + "/camera.yaml");
  const Result<void> is_free = check_not_input("--out", std::filesystem::path(out) / "camera.yaml", given);
  return {{is_free ? "camera.yaml" : "camera-refined.yaml", [&r, comment](const auto& path) {
             return write_file(path, comment + format_camera_file(r.rig));
           }}};
}

// The exit code of a run that has written its result, or why there was none to write.
Result<int> outcome(const TrackResult& result, bool written, const std::string& out,
                    const StopSignals& stop) {
  if (result.report.interrupted) return stop.exit_code();
  if (!result.reconstruction.segments.empty()) return 0;
  const std::string reason = first_reason(result.reconstruction);
  if (written) return no_reconstruction(reason);
  return no_reconstruction(
      fmt::format("{}; the older result in {} stays, failed.json has the report of this run", reason, out));
}

Result<int> run(Arguments& arguments, const CommonOptions& common) {
  TrackSettings& settings = arguments.settings;
  if (arguments.resume) {
    settings.checkpoint = checkpoint_of(arguments.out);
    settings.program_version = RAYSFM_VERSION;
  }
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
  const Result<bool> written =
      write_output_folder(result->reconstruction, result->report, effective_config(settings, RAYSFM_VERSION),
                          arguments.out, found_camera(*result, settings, arguments.out));
  if (!written) return written.error();
  std::error_code failure;  // an interrupted run is gone on from
  if (arguments.resume && !result->report.interrupted) {
    std::filesystem::remove(settings.checkpoint, failure);
  }
  if (!common.quiet && *written) print_summary(*result, arguments.out);
  return outcome(*result, *written, arguments.out, stop);
}

}  // namespace

Command add_track(CLI::App& program, const CommonOptions& common) {
  auto arguments = std::make_shared<Arguments>();
  CLI::App* command = program.add_subcommand("track", "calibrated camera, video to trajectory and map");
  command
      ->add_option("INPUT", arguments->settings.inputs,
                   "video, image folder or pattern, sequence folder, device")
      ->check(named());
  command->add_option("--out", arguments->out, "folder for the results")->required()->check(named());
  command->add_flag(
      "--resume", arguments->resume,
      "leaves checkpoints, and goes on from that of a run that was killed, with the same results");
  add_setting_flags(*command, setting_fields(arguments->settings));
  return [arguments, command, &program, &common]() -> Result<int> {
    const Result<ConfigRecord> config = settle_settings(setting_fields(arguments->settings), *command,
                                                        program, common, &arguments->settings.inputs);
    if (!config) return config.error();
    Result<int> code = run(*arguments, common);
    if (!code) return where_it_was_set(code.error(), *config);
    return code;
  };
}

}  // namespace raysfm::app
