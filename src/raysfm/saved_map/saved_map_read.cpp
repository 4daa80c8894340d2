#include <fmt/format.h>

#include <algorithm>
#include <numeric>
#include <string_view>
#include <utility>

#include "raysfm/camera_files/camera_file.h"
#include "raysfm/saved_map/map_database.h"
#include "raysfm/saved_map/map_rows.h"
#include "raysfm/saved_map/saved_map.h"

namespace raysfm {
namespace {

constexpr int kPoseNumbers = 7, kRayNumbers = 12;
constexpr int64_t kMostWorlds = 1'000'000, kMostKeyFrames = 100'000'000, kMostTracks = 1'000'000'000;
constexpr size_t kMostRigText = 64 << 20;

// How many rows of the other tables belong to a world.
struct WorldRows {
  int keyframes, tracks;
};

Rigid3 pose_of(const double* n) {
  return {Eigen::Quaterniond(n[3], n[0], n[1], n[2]), Eigen::Vector3d(n[4], n[5], n[6])};
}

ObservedRay ray_of(const double* n) {
  ObservedRay ray;
  ray.origin = {n[0], n[1], n[2]};
  ray.direction = {n[3], n[4], n[5]};
  ray.tangents << n[6], n[7], n[8], n[9], n[10], n[11];
  return ray;
}

// Only the project's own form, which leads to no other file.
Result<Rig> parse_rig(const std::string& text) {
  if (!text.starts_with("raysfm_camera: 1\n")) return bad_input("cameras: not the text of a camera file");
  return parse_camera_file(text, "cameras");
}

Result<void> read_rig(sqlite3* database, const std::string& name, SavedMap* map, int* worlds) {
  RowReader row(database, name, "SELECT * FROM map ORDER BY id");
  row.next_row("map");
  row.integer("id", 0, 0);
  const std::string text = row.text("cameras", kMostRigText);
  std::vector<double> poses;
  row.any_array("rig_from_cam", &poses);
  *worlds = static_cast<int>(row.integer("worlds", 0, kMostWorlds));
  if (!row.end_row() || !row.no_more_rows()) return row.error();
  Result<Rig> rig = parse_rig(text);
  if (!rig) return bad_input(fmt::format("{}: {}", name, rig.error().message));
  map->rig = *std::move(rig);
  if (poses.size() != kPoseNumbers * map->rig.cameras.size()) {
    return bad_input(fmt::format("{}: map: rig_from_cam: {} numbers; allowed: {} for each of {} cameras",
                                 name, poses.size(), kPoseNumbers, map->rig.cameras.size()));
  }
  for (size_t c = 0; c < map->rig.cameras.size(); ++c) {
    map->rig.cameras[c].rig_from_cam = pose_of(&poses[kPoseNumbers * c]);
  }
  return {};
}

Result<void> read_worlds(sqlite3* database, const std::string& name, int worlds, SavedMap* map,
                         std::vector<WorldRows>* rows) {
  RowReader row(database, name, "SELECT * FROM world ORDER BY world");
  for (int w = 0; w < worlds && row.next_row(fmt::format("world {}", w)); ++w) {
    Map& world = map->worlds.emplace_back().map;
    row.integer("world", w, w);
    const int64_t keyframes = row.integer("keyframes", 0, kMostKeyFrames);
    const int64_t tracks = row.integer("tracks", 0, kMostTracks);
    world.scale_sigma = row.real("scale_sigma");
    world.guessed_keyframe = static_cast<int>(row.integer("guessed_keyframe", -1, kMostKeyFrames));
    world.guessed_distance = row.real("guessed_distance");
    world.rescaled = row.real("rescaled");
    row.any_array("free_tracks", &world.free_tracks);
    row.end_row();
    rows->push_back({static_cast<int>(keyframes), static_cast<int>(tracks)});
  }
  return row.no_more_rows() ? Result<void>() : row.error();
}

void read_rays(RowReader& row, size_t features, MapArray<ObservedRay>* rays) {
  std::vector<double> numbers;
  if (!row.any_array("rays", &numbers) || numbers.empty()) return;
  if (!row.is_count("rays", numbers.size(), kRayNumbers * features)) return;
  for (size_t f = 0; f < features; ++f) rays->push_back(ray_of(&numbers[kRayNumbers * f]));
}

void read_keyframe(RowReader& row, MapKeyFrame* k, KeyFrameSource* source) {
  constexpr int kMostFeatures = 100'000'000;
  k->frame = static_cast<int>(row.integer("frame", 0, INT32_MAX - 1));
  source->timestamp = row.real("timestamp");
  source->image = row.text("image", kLongestImageName);
  std::vector<double> pose;
  if (row.array("rig_from_world", kPoseNumbers, &pose)) k->rig_from_world = pose_of(pose.data());
  const auto features = static_cast<size_t>(row.integer("features", 0, kMostFeatures));
  row.array("cameras", features, &k->cameras);
  row.array("pixels", features, &k->pixels);
  row.array("octaves", features, &k->octaves);
  row.array("tracks", features, &k->tracks);
  row.array("inliers", features, &k->inliers);
  read_rays(row, features, &k->rays);
  row.any_array("described", &k->described);
  row.array("descriptors", k->described.size(), &k->descriptors);
  row.end_row();
}

Result<void> read_keyframes(sqlite3* database, const std::string& name, const std::vector<WorldRows>& rows,
                            SavedMap* map) {
  RowReader row(database, name, "SELECT * FROM keyframe ORDER BY world, keyframe");
  for (size_t w = 0; w < rows.size(); ++w) {
    SavedWorld& world = map->worlds[w];
    for (int k = 0; k < rows[w].keyframes && row.next_row(fmt::format("world {}, key frame {}", w, k)); ++k) {
      row.integer("world", w, w);
      row.integer("keyframe", k, k);
      read_keyframe(row, &world.map.keyframes.emplace_back(), &world.sources.emplace_back());
    }
  }
  return row.no_more_rows() ? Result<void>() : row.error();
}

void read_block(RowReader& row, size_t count, Map* map) {
  std::vector<double> positions;
  std::vector<uint8_t> flags, colors;
  std::vector<int> lengths;
  std::vector<TrackObservation> observations;
  row.array("positions", 3 * count, &positions);
  row.array("flags", count, &flags);
  row.array("colors", 3 * count, &colors);
  row.array("lengths", count, &lengths);
  row.any_array("observations", &observations);
  if (!row.end_row()) return;
  const bool negative = std::ranges::any_of(lengths, [](int length) { return length < 0; });
  const auto sum = negative ? -1 : std::accumulate(lengths.begin(), lengths.end(), int64_t{0});
  if (!row.is_count("lengths", sum, observations.size())) return;
  const TrackObservation* next = observations.data();
  for (size_t i = 0; i < count; ++i) {
    Track& track = map->tracks.emplace_back();
    track.position = {positions[3 * i], positions[3 * i + 1], positions[3 * i + 2]};
    track.triangulated = flags[i] & 1;
    track.had_position = flags[i] & 2;
    std::copy_n(&colors[3 * i], 3, track.rgb.begin());
    track.observations.assign(next, next + lengths[i]);
    next += lengths[i];
  }
}

Result<void> read_tracks(sqlite3* database, const std::string& name, const std::vector<WorldRows>& rows,
                         SavedMap* map) {
  RowReader row(database, name, "SELECT * FROM track_block ORDER BY world, block");
  for (size_t w = 0; w < rows.size(); ++w) {
    for (int begin = 0, b = 0; begin < rows[w].tracks; begin += kTracksInBlock, ++b) {
      if (!row.next_row(fmt::format("world {}, block {} of tracks", w, b))) return row.error();
      row.integer("world", w, w);
      row.integer("block", b, b);
      read_block(row, std::min(kTracksInBlock, rows[w].tracks - begin), &map->worlds[w].map);
    }
  }
  return row.no_more_rows() ? Result<void>() : row.error();
}

}  // namespace

Result<SavedMap> read_saved_map(const std::filesystem::path& path) {
  const std::string name = path.string();
  const Result<DatabaseHandle> database = open_map_database(path);
  if (!database) return database.error();
  SavedMap map;
  int worlds = 0;
  std::vector<WorldRows> rows;
  Result<void> read = read_rig(database->get(), name, &map, &worlds);
  if (read) read = read_worlds(database->get(), name, worlds, &map, &rows);
  if (read) read = read_keyframes(database->get(), name, rows, &map);
  if (read) read = read_tracks(database->get(), name, rows, &map);
  if (!read) return read.error();
  if (const Result<void> good = check_saved_map(map); !good) {
    return bad_input(fmt::format("{}: {}", name, good.error().message));
  }
  return map;
}

}  // namespace raysfm
