#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <memory>

#include "commands.h"
#include "raysfm/files/text_file.h"
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

}  // namespace

Command add_map(CLI::App& program, const CommonOptions& common) {
  auto file = std::make_shared<std::string>();
  CLI::App* map = program.add_subcommand("map", "look at and check saved maps");
  map->require_subcommand(1);
  CLI::App* show = map->add_subcommand("show", "cameras and worlds of a saved map");
  CLI::App* check = map->add_subcommand("check", "whether a saved map is whole and holds together");
  for (CLI::App* command : {show, check}) command->add_option("FILE", *file, "saved map")->required();

  return [=, &common]() -> Result<int> {
    if (!common.config.empty()) return bad_input("--config is not allowed here, flags are");
    const Result<SavedMap> saved = read_saved_map(*file);
    if (!saved) return saved.error();
    if (common.quiet) return 0;
    return printed(*show ? map_text(*file, *saved) : fmt::format("{}: ok\n", *file));
  };
}

}  // namespace raysfm::app
