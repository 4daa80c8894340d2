#include "raysfm/worlds/world.h"

#include <sstream>

#include "raysfm/worlds/builder.h"

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
      {"terrace", "a street whose fronts and all that stands before them repeat every 10 m", 60},
      {"room", "a furnished room", 15},
      {"corridor", "passages round a block, doors and pillars", 40},
      {"board", "two checkerboards at a right angle", 1},
  };
  return worlds;
}

double usual_length(std::string_view name) {
  for (const WorldInfo& info : world_list()) {
    if (info.name == name) return info.usual_length;
  }
  return 0;
}

Result<World> make_world(std::string_view name, const WorldOptions& options, ThreadPool& pool) {
  const double usual = usual_length(name);
  if (usual == 0) return bad_input("world: '" + std::string(name) + "' is unknown; known: " + names());
  const double most = name == "room" || name == "board" ? usual : 2000;
  if (!(options.length >= 0 && options.length <= most)) {
    std::ostringstream text;
    text << "length: " << options.length << " m is not allowed, world " << name << " has room for up to "
         << most;
    return bad_input(text.str());
  }
  const double length = std::max(options.length, usual);
  Builder builder(std::string(name), options.seed, pool);
  World world = name == "street"     ? build_street(std::move(builder), length)
                : name == "town"     ? build_town(std::move(builder), length)
                : name == "terrace"  ? build_terrace(std::move(builder), length)
                : name == "room"     ? build_room(std::move(builder))
                : name == "corridor" ? build_corridor(std::move(builder), length)
                                     : build_board(std::move(builder));
  world.length = length;
  return world;
}

}  // namespace raysfm::synth
