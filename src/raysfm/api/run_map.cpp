#include "raysfm/api/run_map.h"

#include <fmt/format.h>

#include <utility>

namespace raysfm {

Result<RunMaps> open_maps(const TrackSettings& settings, const EventSink& event) {
  RunMaps maps;
  if (settings.localise && settings.map.empty()) {
    return bad_input("--localise: no map to localise in; give one with --map");
  }
  if (settings.localise && !settings.save_map.empty()) {
    return bad_input("--localise and --save-map: the map stays as it is; one of the two");
  }
  if (!settings.odometry.loops && !settings.map.empty()) {
    return bad_input("--map and --loops off: nothing of the map would be recognised; one of the two");
  }
  if (!settings.save_map.empty()) {
    Result<SavedMapWriter> writer = SavedMapWriter::open(settings.save_map);
    if (!writer) return writer.error();
    maps.writer.emplace(*std::move(writer));
    if (const auto r = keep_far_beside(settings.save_map); !r) {
      tell(event, Event::Level::kWarning, "memory grows with the map: " + r.error().message);
    }
  }
  if (!settings.map.empty()) {
    Result<SavedMap> known = read_saved_map(settings.map);
    if (!known) return known.error();
    maps.known = *std::move(known);
  }
  return maps;
}

Result<Rig> cameras_of_map(const TrackSettings& settings, const SavedMap& known, Rig given) {
  const size_t cameras = known.rig.cameras.size();
  if (given.cameras.size() != cameras) {
    return bad_input(fmt::format("{}: {} cameras; allowed: as many as this run has, {}", settings.map,
                                 cameras, given.cameras.size()));
  }
  for (size_t c = 0; c < cameras; ++c) {
    Camera& camera = given.cameras[c];
    const Camera& of_map = known.rig.cameras[c];
    if (camera.width != of_map.width || camera.height != of_map.height) {
      return bad_input(fmt::format("{}: camera {} of {} x {} pixels; allowed: that of this run, {} x {}",
                                   settings.map, c, of_map.width, of_map.height, camera.width,
                                   camera.height));
    }
    camera.model = of_map.model;
    camera.rig_from_cam = of_map.rig_from_cam;
  }
  return given;
}

std::vector<Map> take_worlds(SavedMap* known) {
  std::vector<Map> worlds;
  for (SavedWorld& world : known->worlds) worlds.push_back(std::exchange(world.map, {}));
  return worlds;
}

Result<void> save_maps(const RunMaps& run, const Reconstruction& reconstruction, std::vector<Map> maps) {
  if (!run.writer || maps.empty()) return {};
  std::vector<KeyFrameSource> known;
  if (run.known) {
    for (const SavedWorld& world : run.known->worlds) {
      known.insert(known.end(), world.sources.begin(), world.sources.end());
    }
  }
  SavedMap saved{reconstruction.rig, {}};
  for (Map& map : maps) {
    SavedWorld& world = saved.worlds.emplace_back();
    for (MapKeyFrame& k : map.keyframes) {
      if (k.frame < 0) {
        world.sources.push_back(known[known.size() + k.frame]);
      } else {
        const PosedFrame& frame = reconstruction.frames[k.frame];
        world.sources.push_back({frame.timestamp, frame.image_name});
      }
      k.frame = static_cast<int>(world.sources.size()) - 1;
    }
    world.map = std::move(map);
  }
  return run.writer->write(saved);
}

}  // namespace raysfm
