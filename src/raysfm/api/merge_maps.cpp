#include "raysfm/api/merge_maps.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <deque>
#include <utility>

#include "raysfm/odometry/mapper.h"
#include "raysfm/places/place_memory.h"

namespace raysfm {
namespace {

// By how much cameras may differ to be the same, refined on other footage: rays by a part of the image's
// width, places in the rig by a part of its extent.
constexpr double kMostRayChange = 0.01, kMostPlaceChange = 0.05;
constexpr int kGrid = 16;  // pixels compared along each side of the image

// The largest change of a ray's direction in the rig, pixels; infinite where one camera has no ray where the
// other has one.
double ray_change(const Camera& a, const Camera& b, double pixels_per_radian) {
  double most = 0;
  for (int row = 0; row <= kGrid; ++row) {
    for (int column = 0; column <= kGrid; ++column) {
      const Eigen::Vector2d pixel(double(column) / kGrid * (a.width - 1),
                                  double(row) / kGrid * (a.height - 1));
      Ray of_a, of_b;
      const bool has_a = a.ray(pixel, &of_a), has_b = b.ray(pixel, &of_b);
      if (has_a != has_b) return INFINITY;
      if (!has_a) continue;
      const Eigen::Vector3d u = a.rig_from_cam.rotation * of_a.direction,
                            v = b.rig_from_cam.rotation * of_b.direction;
      most = std::max(most, pixels_per_radian * std::atan2(u.cross(v).norm(), u.dot(v)));
    }
  }
  return most;
}

double extent(const Rig& rig) {
  double most = 0;
  for (const Camera& camera : rig.cameras) {
    const Eigen::Vector3d& first = rig.cameras[0].rig_from_cam.translation;
    most = std::max(most, (camera.rig_from_cam.translation - first).norm());
  }
  return most;
}

Result<void> check_same_cameras(const TrackingRig& rig, const NamedMap& other, const std::string& first) {
  const std::vector<Camera>& cameras = rig.cameras();
  const std::vector<Camera>& others = other.map.rig.cameras;
  if (others.size() != cameras.size()) {
    return bad_input(fmt::format("{}: {} cameras; allowed: as many as {} has, {}", other.name, others.size(),
                                 first, cameras.size()));
  }
  for (size_t c = 0; c < cameras.size(); ++c) {
    const Camera &a = cameras[c], &b = others[c];
    if (a.width != b.width || a.height != b.height) {
      return bad_input(fmt::format("{}: camera {} of {} x {} pixels; allowed: that of {}, {} x {}",
                                   other.name, c, b.width, b.height, first, a.width, a.height));
    }
    const double change = ray_change(a, b, rig.pixels_per_radian(static_cast<int>(c)));
    if (!(change <= kMostRayChange * a.width)) {
      return bad_input(
          fmt::format("{}: camera {} is another one, rays up to {:.1f} pixels off; allowed: that "
                      "of {}, up to {:.1f}",
                      other.name, c, change, first, kMostRayChange * a.width));
    }
    const double shift = (a.rig_from_cam.translation - b.rig_from_cam.translation).norm();
    const double allowed = kMostPlaceChange * extent(rig.rig());
    if (!(shift <= allowed)) {
      return bad_input(
          fmt::format("{}: camera {} is {:.3g} from its place in the rig; allowed: that of {}, up "
                      "to {:.3g}",
                      other.name, c, shift, first, allowed));
    }
  }
  return {};
}

bool same_calibration(const Rig& a, const Rig& b) {
  return std::ranges::equal(a.cameras, b.cameras, [](const Camera& x, const Camera& y) {
    return ray_change(x, y, 1) == 0 && x.rig_from_cam.translation == y.rig_from_cam.translation;
  });
}

// Joins worlds as they come: each key frame that is a place is looked for among those of other maps.
class WorldMerger {
 public:
  WorldMerger(const TrackingRig& rig, const OdometryOptions& options)
      : rig_(rig), mapper_(rig, options), places_(rig, options.seed) {}

  // The worlds of one map. Those with another calibration are adjusted to the present one.
  void add(SavedMap map) {
    const bool other_rays = !same_calibration(map.rig, rig_.rig());
    const int first = static_cast<int>(worlds_.size());
    for (SavedWorld& saved : map.worlds) {
      worlds_.push_back({std::move(saved.map)});
      Map& world = worlds_.back().map;
      for (MapKeyFrame& k : world.keyframes) {
        renew_rays(rig_, &k);
        k.frame = static_cast<int>(sources_.size());
        sources_.push_back(std::move(saved.sources[&k - world.keyframes.data()]));
      }
      if (other_rays && !world.keyframes.empty()) mapper_.adapt_to_cameras(0, true, &world);
    }
    first_place_ = places_.size();
    for (int w = first; w < static_cast<int>(worlds_.size()); ++w) look_about(w);
  }

  // All worlds, as maps to be written, and where each one is.
  SavedMap finish(std::vector<MergedWorld>* fates) {
    SavedMap out{rig_.rig(), {}};
    std::vector<int> number(worlds_.size(), -1);
    for (size_t w = 0; w < worlds_.size(); ++w) {
      World& world = worlds_[w];
      if (world.map.keyframes.empty()) continue;
      if (world.changed) {
        mapper_.adapt_to_cameras(0, true, &world.map);
        mapper_.measure_scale(ScaleEffort::kFull, &world.map);
      }
      number[w] = static_cast<int>(out.worlds.size());
      SavedWorld& saved = out.worlds.emplace_back();
      saved.map = std::move(world.map);
      for (MapKeyFrame& k : saved.map.keyframes) {
        saved.sources.push_back(std::move(sources_[k.frame]));
        k.frame = static_cast<int>(saved.sources.size()) - 1;
      }
    }
    for (size_t w = 0; w < worlds_.size(); ++w) {
      (*fates)[w].into = number[now(static_cast<int>(w))];
      (*fates)[w].points = worlds_[w].points;
    }
    return out;
  }

 private:
  struct World {
    Map map;
    int joined_into = -1;
    int points = 0;        // by which it was recognised
    bool changed = false;  // brought together with another, or within itself
  };

  // The world that a world is part of.
  int now(int world) const {
    while (worlds_[world].joined_into >= 0) world = worlds_[world].joined_into;
    return world;
  }

  std::vector<Map*> maps() {
    std::vector<Map*> maps;
    for (World& w : worlds_) maps.push_back(&w.map);
    return maps;
  }

  // Looks for every place of a world. Key frames are known by their frames, as their numbers change.
  void look_about(int world) {
    std::vector<int> frames;
    for (const MapKeyFrame& k : worlds_[world].map.keyframes) {
      if (!k.described.empty()) frames.push_back(k.frame);
    }
    for (const int frame : frames) {
      const std::vector<MapKeyFrame>& keyframes = worlds_[now(world)].map.keyframes;
      const auto k = std::ranges::lower_bound(keyframes, frame, {}, &MapKeyFrame::frame);
      meet({now(world), static_cast<int>(k - keyframes.begin())});
    }
  }

  // The run that made the map has looked among its own places.
  void meet(const PlaceRef& here) {
    const std::optional<Meeting> meeting =
        places_.meet(here, maps(), [&](int place) { return place >= first_place_; });
    if (!meeting) return;
    if (meeting->there.world == here.world) {
      bring_together(*meeting);
    } else if (places_.is_confirmed(*meeting, maps())) {
      join(*meeting);
    }
  }

  void bring_together(const Meeting& meeting) {
    World& world = worlds_[meeting.here.world];
    const bool bent = is_bent(meeting, rig_, world.map);
    if (bent) straighten(meeting, rig_, &world.map);
    fuse_points(meeting.relation.points, &world.map);
    if (bent) mapper_.adapt_to_cameras(0, false, &world.map);
    world.changed = true;
  }

  void join(const Meeting& meeting) {
    const JoinedWorlds joined = join_worlds(meeting, maps());
    places_.renumber(joined);
    World& into = worlds_[joined.first];
    fuse_points(joined.points, &into.map);
    mapper_.adapt_to_cameras(0, false, &into.map);
    into.changed = true;
    worlds_[joined.second].joined_into = joined.first;
    worlds_[joined.second].points = static_cast<int>(joined.points.size());
  }

  const TrackingRig& rig_;
  Mapper mapper_;
  PlaceMemory places_;
  std::deque<World> worlds_;             // of all maps
  std::vector<KeyFrameSource> sources_;  // by `frame` of the key frames
  int first_place_ = 0;                  // of the newest map
};

}  // namespace

Result<MergedMaps> merge_maps(std::vector<NamedMap> maps, uint64_t seed) {
  const TrackingRig rig(maps[0].map.rig);
  for (const NamedMap& other : maps) {
    if (auto r = check_same_cameras(rig, other, maps[0].name); !r) return r.error();
  }
  OdometryOptions options;
  options.seed = seed;
  WorldMerger merger(rig, options);
  MergedMaps out;
  for (size_t m = 0; m < maps.size(); ++m) {
    for (size_t w = 0; w < maps[m].map.worlds.size(); ++w) {
      out.worlds.push_back({static_cast<int>(m), static_cast<int>(w)});
    }
    merger.add(std::move(maps[m].map));
  }
  out.map = merger.finish(&out.worlds);
  return out;
}

}  // namespace raysfm
