#include "raysfm/synth/world.h"

#include "raysfm/synth/builder.h"

namespace raysfm::synth {

namespace {

std::string names() {
  std::string all;
  for (const WorldInfo& info : world_list()) all += (all.empty() ? "" : ", ") + std::string(info.name);
  return all;
}

}  // namespace

const std::vector<WorldInfo>& world_list() {
  static const std::vector<WorldInfo> worlds = {
      {"street", "house fronts on both sides, people walking in front of the camera", 70},
      {"town", "a street out and back, with a half-turn round a monument", 500},
      {"room", "a furnished room", 4},
      {"corridor", "passages round a block, doors and pillars", 40},
      {"board", "two checkerboards at a right angle", 1},
  };
  return worlds;
}

Result<World> make_world(std::string_view name, const WorldOptions& options, ThreadPool& pool) {
  const WorldInfo* info = nullptr;
  for (const WorldInfo& candidate : world_list()) {
    if (candidate.name == name) info = &candidate;
  }
  if (!info) return bad_input("world: '" + std::string(name) + "' is unknown; known: " + names());
  const bool grows = name != "room" && name != "board";
  const double length = options.length == 0 ? info->default_length : options.length;
  const double least = name == "town" ? 120 : 1, most = grows ? 2000 : info->default_length;
  if (!(length >= least && length <= most)) {
    return bad_input("length: " + std::to_string(options.length) + " m is outside [" + std::to_string(least) +
                     ", " + std::to_string(most) + "], which is what world " + std::string(name) + " allows");
  }
  Builder builder(std::string(name), options.seed, pool);
  World world = name == "street"     ? build_street(std::move(builder), length)
                : name == "town"     ? build_town(std::move(builder), length)
                : name == "room"     ? build_room(std::move(builder))
                : name == "corridor" ? build_corridor(std::move(builder), length)
                                     : build_board(std::move(builder));
  world.length = length;
  return world;
}

}  // namespace raysfm::synth
