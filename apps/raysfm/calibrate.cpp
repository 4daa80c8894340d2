#include "raysfm/api/calibrate.h"

#include <fmt/format.h>

#include <cmath>
#include <cstdio>
#include <filesystem>
#include <memory>

#include "commands.h"
#include "raysfm/camera/camera_check.h"
#include "raysfm/files/atomic_file.h"
#include "raysfm/plots/board_plot.h"
#include "setting_flags.h"
#include "terminal.h"

namespace raysfm::app {
namespace {

struct CalibrateArguments {
  CalibrateSettings settings;
  std::string out, plot;
};

std::string numbers_text(const CalibrateResult& result, size_t c) {
  const BoardCalibration& calibration = result.calibration;
  std::string text;
  const auto parameters = camera_parameters(calibration.problem.rig.cameras[c].model);
  for (size_t i = 0; i < parameters.size(); ++i) {
    if (calibration.problem.scales[c][i] == 0) continue;
    text += fmt::format("  {:<6} {:>12.6g}  standard deviation {:.2g}\n", parameters[i].first,
                        parameters[i].second, calibration.sigmas.numbers[c][i]);
  }
  return text;
}

std::string result_text(const CalibrateResult& result, const CalibrateArguments& arguments) {
  const BoardCalibration& calibration = result.calibration;
  std::string text = fmt::format("{} of {} images show the board, {} different views used\n", result.found,
                                 result.images, result.views);
  const Rig& rig = calibration.problem.rig;
  for (size_t c = 0; c < rig.cameras.size(); ++c) {
    const Camera& camera = rig.cameras[c];
    text += fmt::format("{}: {}, {} x {}, rms {:.3g} px\n{}", camera.name, model_name(camera.model),
                        camera.width, camera.height, calibration.camera_rms_px[c], numbers_text(result, c));
  }
  for (const std::string& place : placements(rig)) text += place + "\n";
  if (rig.cameras.size() > 1 && arguments.settings.square == 0)
    text += "distances are in squares of the board (--square)\n";
  for (const std::string& image : calibration.left_out) text += "left out: " + image + "\n";
  for (const std::string& advice : result.advice) text += "film more: " + advice + "\n";
  return text + fmt::format("written to {} and {}\n", arguments.out, arguments.plot);
}

Result<void> check_outputs(const CalibrateArguments& arguments) {
  if (auto r = check_not_input("--out", arguments.out, arguments.settings.inputs); !r) return r;
  return check_not_input("--plot", arguments.plot, arguments.settings.inputs);
}

Result<int> run_calibrate(CalibrateArguments arguments, const CommonOptions& common) {
  if (arguments.plot.empty()) arguments.plot = std::filesystem::path(arguments.out).replace_extension(".png");
  const StopSignals stop;
  ProgressLine line(common.quiet);
  CalibrateCallbacks callbacks;
  callbacks.stop = stop.requested();
  callbacks.ready = [&] { return check_outputs(arguments); };
  callbacks.progress = [&](int done, int total) {
    if (line.terminal())
      line.show(fmt::format("image {}{}", done, total < 0 ? "" : fmt::format("/{}", total)));
  };
  const Result<CalibrateResult> result = calibrate(arguments.settings, callbacks);
  line.finish();
  if (!result && stop.requested()->load()) {
    line.line("interrupted before there was anything to write");
    return stop.exit_code();
  }
  if (!result) return result.error();
  if (auto r = write_file(arguments.out, calibrated_camera_text(*result, arguments.settings)); !r)
    return r.error();
  if (auto r = plot_boards(result->calibration, arguments.plot); !r) return r.error();
  for (const std::string& note : result->notes) line.event({Event::Level::kInfo, note});
  return common.quiet ? Result<int>(0) : printed(result_text(*result, arguments));
}

}  // namespace

Command add_calibrate(CLI::App& camera, const CommonOptions& common) {
  auto arguments = std::make_shared<CalibrateArguments>();
  CLI::App* command =
      camera.add_subcommand("calibrate", "camera file, with standard deviations, from views of a chessboard");
  command
      ->add_option("INPUT", arguments->settings.inputs,
                   "video, image folder or pattern; several are the cameras of a rig, in step")
      ->required()
      ->check(named());
  command->add_option("--out", arguments->out, "camera file to write")->required()->check(named());
  command
      ->add_option("--plot", arguments->plot,
                   "picture of corners and errors; default: beside the camera file")
      ->type_name("FILE.png");
  add_setting_flags(*command, setting_fields(arguments->settings));
  return [arguments, &common]() -> Result<int> {
    arguments->settings.threads = common.threads;
    return run_calibrate(*arguments, common);
  };
}

}  // namespace raysfm::app
