#include "raysfm/exports/export.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <cstdio>
#include <memory>

#include "commands.h"
#include "terminal.h"

namespace raysfm::app {
namespace {

struct ExportArguments {
  ExportSettings settings;
  std::string result, out;
};

Result<int> run_export(const ExportArguments& arguments, const CommonOptions& common) {
  if (!common.config.empty()) return bad_input("--config is not allowed here, flags are");
  ExportSettings settings = arguments.settings;
  settings.result = arguments.result;
  settings.out = arguments.out;
  settings.threads = common.threads;
  ProgressLine line(common.quiet);
  const Result<ExportSummary> summary = export_result(settings, [&](const char* stage, int done, int total) {
    if (line.terminal()) line.show(fmt::format("{} {}/{}", stage, done, total));
  });
  line.finish();
  if (!summary) return summary.error();
  if (common.quiet) return 0;
  for (const std::string& note : summary->notes)
    std::fprintf(stderr, "raysfm export: note: %s\n", note.c_str());
  std::string counts = fmt::format("{} frames with a pose", summary->frames);
  if (summary->faces > 0) counts += fmt::format(", {} faces", summary->faces);
  if (summary->images > 0) counts += fmt::format(", {} images", summary->images);
  std::printf("%s, %d points; written to %s\n", counts.c_str(), summary->points, summary->out.c_str());
  return 0;
}

}  // namespace

Command add_export(CLI::App& program, const CommonOptions& common) {
  auto arguments = std::make_shared<ExportArguments>();
  ExportSettings& settings = arguments->settings;
  CLI::App* command = program.add_subcommand("export", "a finished result in another tool's format");
  command->add_option("DIR", arguments->result, "output folder of track, solve or adjust")->required();
  command->add_option("--format", settings.format, fmt::format("{}", fmt::join(export_formats(), ", ")))
      ->required();
  command->add_option("--out", arguments->out, "folder to write; default: DIR-FORMAT, beside DIR")
      ->type_name("PATH");
  command->add_option("--world", settings.world, "which of several worlds, as in report.json")
      ->capture_default_str();
  command->add_flag("--text", settings.text, "COLMAP's text files instead of binary ones");
  command->add_flag("--undistort", settings.undistort,
                    "cameras become pinholes, those wider than 60 degrees off the axis the faces of a cube");
  command
      ->add_option(
          "--images", settings.images,
          "video or folder of the frames: their images are written too; of a mesh, they are its texture")
      ->type_name("PATH");
  command
      ->add_option("--texture-side", settings.texture_side,
                   "most texels along a side of the texture of --format mesh")
      ->capture_default_str();
  command->add_flag("--all-frames", settings.all_frames, "every frame with a pose, not key frames alone");
  command->add_option("--camera", settings.camera, "camera file, for results that do not tell their cameras")
      ->type_name("FILE");
  return [arguments, &common] { return run_export(*arguments, common); };
}

}  // namespace raysfm::app
