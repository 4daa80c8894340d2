#include "raysfm/merging/merge_maps.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <deque>
#include <map>
#include <optional>
#include <set>
#include <utility>

#include "raysfm/calibration/calibration_refiner.h"
#include "raysfm/calibration/refined_rig.h"
#include "raysfm/geometry/point_alignment.h"
#include "raysfm/geometry/similarity.h"
#include "raysfm/mapping/mapper.h"
#include "raysfm/merging/common_points.h"
#include "raysfm/places/place_memory.h"

namespace raysfm {
namespace {

// By how much cameras may differ to be the same, refined on other footage: rays by a part of the image's
// width, places in the rig by a part of its extent.
constexpr double kMostRayChange = 0.01, kMostPlaceChange = 0.05;
constexpr size_t kLeastCommon = 30;  // points by which two worlds of one video are joined
constexpr int kMostRounds = 8;       // of cameras, each from where the one before led
constexpr size_t kGrowth = 2;        // of the key frames of a world, from which cameras are worth a new look
constexpr int kGrid = 16;            // pixels compared along each side of the image

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

Result<void> check_same_cameras(const TrackingRig& rig, const NamedMap& other, const std::string& first,
                                double most_ray_change) {
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
    if (!(change <= most_ray_change * a.width)) {
      return bad_input(
          fmt::format("{}: camera {} is another one, rays up to {:.1f} pixels off; allowed: that "
                      "of {}, up to {:.1f}",
                      other.name, c, change, first, most_ray_change * a.width));
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

// The map whose cameras are most like those of all others.
size_t most_typical(const std::vector<NamedMap>& maps) {
  size_t best = 0;
  double least = HUGE_VAL;
  for (size_t m = 0; m < maps.size(); ++m) {
    double sum = 0;
    for (const NamedMap& other : maps) {
      const std::vector<Camera>&a = maps[m].map.rig.cameras, &b = other.map.rig.cameras;
      if (a.size() != b.size()) sum = HUGE_VAL;
      for (size_t c = 0; c < std::min(a.size(), b.size()); ++c) sum += ray_change(a[c], b[c], 1);
    }
    if (sum < least) best = m, least = sum;
  }
  return best;
}

// Points of two worlds of different maps that are the same.
struct CommonWorlds {
  int map = 0, world = 0, other_map = 0, other_world = 0;
  std::vector<CommonPoint> points;
};

// Of each two worlds that known views connect, in the order of their maps.
std::vector<CommonWorlds> find_common_worlds(const std::vector<NamedMap>& maps,
                                             std::span<const KnownView> known) {
  using Worlds = std::array<int, 4>;  // map and world, and of a later map
  std::map<Worlds, std::array<std::vector<KnownPose>, 2>> poses_of;
  for (const KnownView& v : known) {
    const bool is_first = v.map < v.other_map;
    const Worlds worlds = is_first ? Worlds{v.map, v.world, v.other_map, v.other_world}
                                   : Worlds{v.other_map, v.other_world, v.map, v.world};
    poses_of[worlds][is_first ? 0 : 1].push_back({v.keyframe, v.rig_from_other});
  }
  std::vector<TrackingRig> rigs;
  for (const NamedMap& m : maps) rigs.emplace_back(m.map.rig);
  std::vector<CommonWorlds> all;
  for (const auto& [w, poses] : poses_of) {
    all.push_back({w[0], w[1], w[2], w[3],
                   find_common_points({rigs[w[0]], maps[w[0]].map.worlds[w[1]].map, poses[0]},
                                      {rigs[w[2]], maps[w[2]].map.worlds[w[3]].map, poses[1]})});
  }
  return all;
}

// Joins worlds as they come: each key frame that is a place is looked for among those of other maps.
class WorldMerger {
 public:
  WorldMerger(const Rig& rig, const OdometryOptions& options)
      : rig_(rig), mapper_(rig_, options), places_(rig_, options.seed) {}

  // The worlds of one map, and what they have in common with those before. Those with another calibration are
  // adjusted to the present one.
  void add(SavedMap map, std::span<const CommonWorlds> common) {
    const bool other_rays = !same_calibration(map.rig, rig_.rig());
    const int first = static_cast<int>(worlds_.size());
    first_of_map_.push_back(first);
    for (SavedWorld& saved : map.worlds) {
      worlds_.push_back({std::move(saved.map)});
      worlds_.back().first_source = static_cast<int>(sources_.size());
      Map& world = worlds_.back().map;
      for (MapKeyFrame& k : world.keyframes) {
        renew_rays(rig_, &k);
        k.frame = static_cast<int>(sources_.size());
        sources_.push_back(std::move(saved.sources[&k - world.keyframes.data()]));
        map_of_.push_back(maps_added_);
      }
      most_added_ = std::max(most_added_, world.keyframes.size());
      if (!other_rays || world.keyframes.empty()) continue;
      mapper_.adapt_to_cameras(0, Adaption::kToTheEnd, &world);
      worlds_.back().changed = true;
    }
    ++maps_added_;
    join_common(common);
    first_place_ = places_.size();
    for (int w = first; w < static_cast<int>(worlds_.size()); ++w) look_about(w);
  }

  // What each map made of the cameras was made of what it saw: much more together tells them better.
  // `numbers` say how the present cameras were refined, and then how they are. None: nobody was to.
  void refine_cameras(std::vector<CalibrationNumber>* numbers) {
    size_t most = 0;
    for (const World& world : worlds_) most = std::max(most, count_images(world.map));
    if (numbers->empty() || most < kGrowth * most_added_) return;
    CalibrationRefiner refiner(refined_rig(rig_.rig(), *numbers));
    use_cameras(refiner.rig());
    for (int round = 0; round < kMostRounds; ++round) {
      for (size_t w = 0; w < worlds_.size(); ++w) {
        if (!worlds_[w].map.keyframes.empty())
          refiner.measure_again(rig_, static_cast<int>(w), worlds_[w].map, {}, {});
      }
      const std::optional<Rig> better = refiner.better(true);
      if (!better) break;
      use_cameras(*better);
      if (!refiner.take_over() && rig_.central()) break;
    }
    for (const CalibrationNumber& now : refiner.numbers()) {
      const auto is_it = [&](const CalibrationNumber& n) {
        return n.camera == now.camera && n.name == now.name;
      };
      std::ranges::replace_if(*numbers, is_it, now);
    }
  }

  // All worlds, as maps to be written, and where each one is; `worlds` of `merged` are those that were added.
  void finish(MergedMaps* merged) {
    SavedMap& out = merged->map;
    out.rig = rig_.rig();
    std::vector<int> number(worlds_.size(), -1);
    for (size_t w = 0; w < worlds_.size(); ++w) {
      World& world = worlds_[w];
      if (world.map.keyframes.empty()) continue;
      if (world.changed) {
        mapper_.adapt_to_cameras(0, Adaption::kToTheEnd, &world.map);
        mapper_.measure_scale(ScaleEffort::kFull, &world.map);
      }
      number[w] = static_cast<int>(out.worlds.size());
      SavedWorld& saved = out.worlds.emplace_back();
      std::vector<int>& map_of_keyframe = merged->map_of_keyframe.emplace_back();
      saved.map = std::move(world.map);
      for (MapKeyFrame& k : saved.map.keyframes) {
        saved.sources.push_back(std::move(sources_[k.frame]));
        map_of_keyframe.push_back(map_of_[k.frame]);
        k.frame = static_cast<int>(saved.sources.size()) - 1;
      }
    }
    for (size_t w = 0; w < worlds_.size(); ++w) {
      merged->worlds[w].into = number[now(static_cast<int>(w))];
      merged->worlds[w].points = worlds_[w].points;
    }
  }

 private:
  struct World {
    Map map;
    Similarity3 now_from_added = {};  // of what it is part of now
    int first_source = 0;             // of its key frames as they were added
    int joined_into = -1;
    int points = 0;  // by which it was recognised
    bool changed =
        false;  // brought together with another, or within itself, and not adjusted as a whole since
  };

  void use_cameras(const Rig& cameras) {
    rig_ = TrackingRig(cameras);
    for (World& world : worlds_) {
      if (world.map.keyframes.empty()) continue;
      mapper_.adapt_to_cameras(0, Adaption::kToTheEnd, &world.map);
      mapper_.measure_scale(ScaleEffort::kFull, &world.map);
      world.changed = false;
    }
  }

  // An image that is a key frame of two maps tells what it shows once.
  size_t count_images(const Map& map) const {
    std::set<double> timestamps;
    for (const MapKeyFrame& k : map.keyframes) timestamps.insert(sources_[k.frame].timestamp);
    return timestamps.size();
  }

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
    for (const int frame : frames) meet(place_of_frame(world, frame));
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
      mapper_.adapt_to_cameras(0, Adaption::kTwoSeries, &worlds_[now(here.world)].map);
    }
  }

  void bring_together(const Meeting& meeting) {
    World& world = worlds_[meeting.here.world];
    const bool bent = is_bent(meeting, rig_, world.map);
    if (bent) straighten(meeting, rig_, &world.map);
    fuse_points(meeting.relation.points, &world.map);
    if (bent) mapper_.adapt_to_cameras(0, Adaption::kTwoSeries, &world.map);
    world.changed = true;
  }

  void join(const Meeting& meeting) {
    const JoinedWorlds joined = join_worlds(meeting, maps());
    places_.renumber(joined);
    const Similarity3 rescaled{joined.first_rescaled, Eigen::Quaterniond::Identity(),
                               Eigen::Vector3d::Zero()};
    for (size_t w = 0; w < worlds_.size(); ++w) {
      if (now(static_cast<int>(w)) != joined.first && now(static_cast<int>(w)) != joined.second) continue;
      const bool is_of_first = now(static_cast<int>(w)) == joined.first;
      worlds_[w].now_from_added =
          (is_of_first ? rescaled : joined.first_from_second) * worlds_[w].now_from_added;
    }
    World& into = worlds_[joined.first];
    fuse_points(joined.points, &into.map);
    into.changed = true;
    worlds_[joined.second].joined_into = joined.first;
    worlds_[joined.second].points = static_cast<int>(joined.points.size());
  }

  int world_of(int map, int world) const { return first_of_map_[map] + world; }

  // Where the key frame of a frame is now that was added with a world; or that of its number there.
  PlaceRef place_of_frame(int added_world, int frame) const {
    const int world = now(added_world);
    const std::vector<MapKeyFrame>& keyframes = worlds_[world].map.keyframes;
    const auto k = std::ranges::lower_bound(keyframes, frame, {}, &MapKeyFrame::frame);
    return {world, static_cast<int>(k - keyframes.begin())};
  }
  PlaceRef place_of(int added_world, int keyframe) const {
    return place_of_frame(added_world, worlds_[added_world].first_source + keyframe);
  }

  // The track of an observation as a world was added; -1: it was given up since.
  int track_now(int added_world, const TrackObservation& o) const {
    const PlaceRef place = place_of(added_world, o.keyframe);
    return worlds_[place.world].map.keyframes[place.keyframe].tracks[o.feature];
  }

  // What worlds that were added have in common, as tracks of the worlds that they are part of.
  std::vector<SamePoint> points_now(const CommonWorlds& common) const {
    std::vector<SamePoint> points;
    for (const CommonPoint& p : common.points) {
      const int a = track_now(world_of(common.map, common.world), p.of_a),
                b = track_now(world_of(common.other_map, common.other_world), p.of_b);
      if (a >= 0 && b >= 0) points.push_back({a, b});
    }
    return points;
  }

  Meeting meeting_of(const CommonWorlds& common, int a, int b) {
    const Map &of_a = worlds_[now(a)].map, &of_b = worlds_[now(b)].map;
    Meeting meeting;
    meeting.here.world = now(b);
    meeting.there.world = now(a);
    std::vector<Eigen::Vector3d> here, there;
    for (const SamePoint& p : points_now(common)) {
      meeting.relation.points.push_back({p.there, p.here});
      here.push_back(of_b.tracks[p.there].position);
      there.push_back(of_a.tracks[p.here].position);
    }
    meeting.relation.there_from_here =
        align_points(std::move(here), std::move(there), !has_same_scale(rig_, of_a, of_b));
    return meeting;
  }

  // The worlds of the newest map are joined with those before that have points in common with them. That fits
  // well enough to be adjusted in the end.
  void join_common(std::span<const CommonWorlds> all) {
    for (const CommonWorlds& common : all) {
      if (common.other_map + 1 != maps_added_ || common.points.size() < kLeastCommon) continue;
      const int a = world_of(common.map, common.world), b = world_of(common.other_map, common.other_world);
      if (now(a) != now(b)) {
        join(meeting_of(common, a, b));
      } else {
        fuse_points(points_now(common), &worlds_[now(a)].map);
        worlds_[now(a)].changed = true;
      }
    }
  }

  TrackingRig rig_;
  Mapper mapper_;
  PlaceMemory places_;
  std::deque<World> worlds_;             // of all maps
  std::vector<int> first_of_map_;        // of the worlds that were added with a map
  std::vector<KeyFrameSource> sources_;  // by `frame` of the key frames
  std::vector<int> map_of_;              // likewise, the map that each was added with
  int maps_added_ = 0;
  size_t most_added_ = 0;  // key frames of a world
  int first_place_ = 0;    // of the newest map
};

}  // namespace

Result<MergedMaps> merge_maps(std::vector<NamedMap> maps, uint64_t seed, std::span<const KnownView> known) {
  const bool is_one_video = !known.empty();
  const size_t reference = is_one_video ? most_typical(maps) : 0;
  const TrackingRig rig(maps[reference].map.rig);
  std::vector<CalibrationNumber> calibration = maps[reference].calibration;
  for (const NamedMap& other : maps) {
    // Of one video they are the same, whatever each piece made of the little that it saw.
    const double most = is_one_video ? INFINITY : kMostRayChange;
    if (auto r = check_same_cameras(rig, other, maps[reference].name, most); !r) return r.error();
  }
  OdometryOptions options;
  options.seed = seed;
  const std::vector<CommonWorlds> common = find_common_worlds(maps, known);
  WorldMerger merger(rig.rig(), options);
  MergedMaps out;
  for (size_t m = 0; m < maps.size(); ++m) {
    for (size_t w = 0; w < maps[m].map.worlds.size(); ++w) {
      out.worlds.push_back({static_cast<int>(m), static_cast<int>(w)});
    }
    merger.add(std::move(maps[m].map), common);
  }
  out.calibration = std::move(calibration);
  if (is_one_video) merger.refine_cameras(&out.calibration);
  merger.finish(&out);
  return out;
}

}  // namespace raysfm
