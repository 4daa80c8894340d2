#include <fmt/format.h>

#include <cstdio>
#include <filesystem>
#include <memory>
#include <sstream>
#include <string>
#include <string_view>
#include <vector>

#include "commands.h"
#include "raysfm/camera/camera_class.h"
#include "raysfm/camera_files/camera_file.h"
#include "raysfm/core/memory.h"
#include "raysfm/core/timer.h"
#include "raysfm/files/atomic_file.h"
#include "raysfm/files/text_file.h"
#include "raysfm/merging/join_pieces.h"
#include "raysfm/results/output_folder.h"
#include "raysfm/results/reconstruction_folder.h"
#include "raysfm/scene/worlds.h"
#include "raysfm/views/tracking_rig.h"
#include "setting_flags.h"
#include "terminal.h"

namespace raysfm::app {
namespace {

namespace fs = std::filesystem;

constexpr const char* kMap = "map.raysfm";

struct JoinArguments {
  std::vector<std::string> pieces;
  std::string out;
};

Result<std::vector<VideoPiece>> read_pieces(const std::vector<std::string>& folders) {
  std::vector<VideoPiece> pieces;
  for (const std::string& folder : folders) {
    Result<Reconstruction> result = read_reconstruction(folder);
    if (!result) return result.error();
    VideoPiece& piece = pieces.emplace_back();
    piece.name = folder;
    piece.result = *std::move(result);
    if (posed_count(piece.result) == 0) continue;
    Result<SavedMap> map = read_saved_map(fs::path(folder) / kMap);
    if (!map) return map.error();
    piece.map = *std::move(map);
  }
  return pieces;
}

// config.yaml of the first piece, without what is of the piece alone.
std::string config_of(const fs::path& piece) {
  constexpr uintmax_t kMaxConfigBytes = 1 << 20;
  const Result<std::string> text = read_text_file(piece / "config.yaml", kMaxConfigBytes);
  if (!text) return {};
  std::istringstream lines(*text);
  std::string config;
  for (std::string line; std::getline(lines, line);) {
    const auto is = [&](std::string_view name) { return line.starts_with(name); };
    if (!is("from:") && !is("to:") && !is("save-map:")) config += line + "\n";
  }
  return config;
}

Report report_of(const JoinedPieces& joined, const JoinArguments& arguments, uint64_t seed) {
  const TrackingRig rig(joined.result.rig);
  Report report;
  report.version = RAYSFM_VERSION;
  report.seed = seed;
  report.input = inputs_of_result(arguments.pieces[0]);
  report.camera_class = to_string(camera_class(rig.rig()));
  report.error = rig.angular() ? "angular" : "pixel";
  report.frames_in_input = static_cast<int>(joined.result.frames.size());
  return report;
}

std::string joined_text(const MergedWorld& world) {
  if (world.points == 0) return fmt::format("piece {}, world {}: on its own\n", world.map + 1, world.world);
  return fmt::format("piece {}, world {}: joined, {} of its points are seen again\n", world.map + 1,
                     world.world, world.points);
}

Result<int> run_join(const JoinArguments& arguments, const CommonOptions& common) {
  if (!common.config.empty()) return bad_input("--config is not allowed here, flags are");
  const Clock::time_point start = Clock::now();
  for (const std::string& piece : arguments.pieces) {
    std::error_code failure;
    if (!fs::equivalent(piece, arguments.out, failure)) continue;
    return bad_input(fmt::format("--out = {}: is one of the pieces", arguments.out));
  }
  if (auto r = prepare_output_folder(arguments.out); !r) return r.error();
  const Result<SavedMapWriter> map = SavedMapWriter::open((fs::path(arguments.out) / kMap).string());
  if (!map) return map.error();
  if (const auto r = keep_far_beside(fs::path(arguments.out) / kMap); !r) {
    ProgressLine(common.quiet)
        .event({Event::Level::kWarning, "memory grows with the maps: " + r.error().message});
  }
  Result<std::vector<VideoPiece>> pieces = read_pieces(arguments.pieces);
  if (!pieces) return pieces.error();
  const Result<JoinedPieces> joined = join_pieces(*std::move(pieces), common.seed);
  if (!joined) return joined.error();
  const Reconstruction& r = joined->result;
  Report report = report_of(*joined, arguments, common.seed);
  report.wall_s = milliseconds_since(start) / 1000;
  report.peak_rss_mib = peak_rss_mib();
  const ResultFile cameras[] = {
      {"camera.yaml", [&](const fs::path& path) { return write_file(path, format_camera_file(r.rig)); }}};
  if (auto w = map->write(joined->map); !w) return w.error();
  const Result<bool> written =
      write_output_folder(r, std::move(report), config_of(arguments.pieces[0]), arguments.out, cameras);
  if (!written) return written.error();
  if (common.quiet) return 0;
  std::string text;
  for (const MergedWorld& world : joined->worlds) text += joined_text(world);
  return printed(text + fmt::format("{}; written to {}\n", counts_text(r), arguments.out));
}

}  // namespace

Command add_join(CLI::App& program, const CommonOptions& common) {
  auto arguments = std::make_shared<JoinArguments>();
  CLI::App* command =
      program.add_subcommand("join", "results of overlapping pieces of one video as one result");
  command->footer("A piece is the output folder of track --from --to --save-map PIECE/map.raysfm.");
  command->add_option("PIECES", arguments->pieces, "results of the pieces, with their maps")
      ->required()
      ->expected(1, -1)
      ->check(named());
  command->add_option("--out", arguments->out, "folder for the whole")->required()->check(named());
  return [arguments, &common] { return run_join(*arguments, common); };
}

}  // namespace raysfm::app
