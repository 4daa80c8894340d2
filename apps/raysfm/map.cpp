#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <memory>
#include <span>

#include "commands.h"
#include "raysfm/files/atomic_file.h"
#include "raysfm/files/text_file.h"
#include "raysfm/merging/merge_maps.h"
#include "raysfm/saved_map/saved_map.h"
#include "terminal.h"

namespace raysfm::app {
namespace {

std::string scale_text(const Map& map) {
  if (!std::isfinite(map.scale_sigma)) return "scale unknown";
  return fmt::format("scale known within {:.2g} %", 100 * map.scale_sigma);
}

std::string world_text(size_t index, const SavedWorld& world) {
  const Map& map = world.map;
  size_t observations = 0, descriptors = 0;
  for (const Track& track : map.tracks) observations += track.triangulated ? track.observations.size() : 0;
  for (const MapKeyFrame& k : map.keyframes) descriptors += k.descriptors.size();
  const auto points = std::ranges::count_if(map.tracks, &Track::triangulated);
  std::string text =
      fmt::format("world {}: {} key frames, {} points, {} observations, {} descriptors, {}\n", index,
                  map.keyframes.size(), points, observations, descriptors, scale_text(map));
  if (world.sources.empty()) return text;
  const auto [first, last] = std::ranges::minmax(world.sources, {}, &KeyFrameSource::timestamp);
  return text + fmt::format("  from {:.3f} s to {:.3f} s\n", first.timestamp, last.timestamp);
}

std::string map_text(const std::string& file, const SavedMap& map) {
  std::error_code failure;
  std::string text = fmt::format("{}: saved map, version {}, {} bytes\n", file, kSavedMapVersion,
                                 std::filesystem::file_size(file, failure));
  for (const Camera& camera : map.rig.cameras) {
    text += fmt::format("camera {}: {}, {} x {}\n", shown(camera.name), model_name(camera.model),
                        camera.width, camera.height);
  }
  for (size_t w = 0; w < map.worlds.size(); ++w) text += world_text(w, map.worlds[w]);
  return text;
}

std::string fate_text(const MergedWorld& world, const std::vector<std::string>& files) {
  const std::string name = fmt::format("{}, world {}", files[world.map], world.world);
  if (world.into < 0) return fmt::format("{}: left out, it has no key frames\n", name);
  if (world.points == 0) return fmt::format("{}: world {}\n", name, world.into);
  return fmt::format("{}: joined to world {}, where {} of its points are seen again\n", name, world.into,
                     world.points);
}

// What became of each world, for the user.
Result<std::string> merge(const std::vector<std::string>& files, const std::string& out, uint64_t seed) {
  if (auto r = check_not_input("--out", out, files); !r) return r.error();
  Result<SavedMapWriter> writer = SavedMapWriter::open(out);
  if (!writer) return writer.error();
  std::vector<NamedMap> maps;
  for (size_t f = 0; f < files.size(); ++f) {
    if (auto r = check_not_input("FILE", files[f], std::span(files).first(f)); !r) {
      return bad_input(fmt::format("{}: given twice", files[f]));
    }
    Result<SavedMap> map = read_saved_map(files[f]);
    if (!map) return map.error();
    maps.push_back({files[f], *std::move(map)});
  }
  const Result<MergedMaps> merged = merge_maps(std::move(maps), seed);
  if (!merged) return merged.error();
  if (auto r = writer->write(merged->map); !r) return r.error();
  std::string text;
  for (const MergedWorld& world : merged->worlds) text += fate_text(world, files);
  return text + map_text(out, merged->map);
}

}  // namespace

Command add_map(CLI::App& program, const CommonOptions& common) {
  struct Arguments {
    std::string file, out;
    std::vector<std::string> files;
  };
  auto given = std::make_shared<Arguments>();
  CLI::App* map = program.add_subcommand("map", "look at, check and merge saved maps");
  map->require_subcommand(1);
  CLI::App* show = map->add_subcommand("show", "cameras and worlds of a saved map");
  CLI::App* check = map->add_subcommand("check", "whether a saved map is whole and holds together");
  for (CLI::App* command : {show, check}) command->add_option("FILE", given->file, "saved map")->required();
  CLI::App* merge_command =
      map->add_subcommand("merge", "one map of several; worlds of one place are joined");
  merge_command->add_option("FILES", given->files, "saved maps, of the same cameras")
      ->required()
      ->expected(2, -1);
  merge_command->add_option("--out", given->out, "file to write")->required();

  return [=, &common]() -> Result<int> {
    if (!common.config.empty()) return bad_input("--config is not allowed here, flags are");
    if (*merge_command) {
      const Result<std::string> text = merge(given->files, given->out, common.seed);
      if (!text) return text.error();
      return common.quiet ? Result<int>(0) : printed(*text);
    }
    const Result<SavedMap> saved = read_saved_map(given->file);
    if (!saved) return saved.error();
    if (common.quiet) return 0;
    return printed(*show ? map_text(given->file, *saved) : fmt::format("{}: ok\n", given->file));
  };
}

}  // namespace raysfm::app
