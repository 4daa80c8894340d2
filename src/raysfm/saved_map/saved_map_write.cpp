#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <utility>

#include "raysfm/camera_files/camera_file.h"
#include "raysfm/core/paged_memory.h"
#include "raysfm/files/atomic_file.h"
#include "raysfm/saved_map/map_database.h"
#include "raysfm/saved_map/map_rows.h"
#include "raysfm/saved_map/saved_map.h"

namespace raysfm {
namespace {

// Rotation x, y, z, w, then translation.
void append_pose(const Rigid3& pose, std::vector<double>* numbers) {
  const Eigen::Quaterniond& q = pose.rotation;
  const Eigen::Vector3d& t = pose.translation;
  numbers->insert(numbers->end(), {q.x(), q.y(), q.z(), q.w(), t.x(), t.y(), t.z()});
}

// Origin, direction, then the rows of the tangents.
std::vector<double> ray_numbers(const MapArray<ObservedRay>& rays) {
  std::vector<double> numbers;
  numbers.reserve(12 * rays.size());
  for (const ObservedRay& ray : rays) {
    numbers.insert(numbers.end(), ray.origin.begin(), ray.origin.end());
    numbers.insert(numbers.end(), ray.direction.begin(), ray.direction.end());
    for (const int row : {0, 1}) {
      for (const int column : {0, 1, 2}) numbers.push_back(ray.tangents(row, column));
    }
  }
  return numbers;
}

bool write_rig(sqlite3* database, const SavedMap& map) {
  const std::string cameras = format_camera_file(map.rig);
  std::vector<double> poses;
  for (const Camera& camera : map.rig.cameras) append_pose(camera.rig_from_cam, &poses);
  RowWriter row(database, "map", 5);
  row.integer(0);
  row.text(cameras);
  row.array(poses);
  row.integer(static_cast<int64_t>(map.worlds.size()));
  return row.end_row();
}

bool write_worlds(sqlite3* database, const SavedMap& map) {
  RowWriter row(database, "world", 9);
  bool good = true;
  for (size_t w = 0; good && w < map.worlds.size(); ++w) {
    const Map& world = map.worlds[w].map;
    row.integer(static_cast<int64_t>(w));
    row.integer(static_cast<int64_t>(world.keyframes.size()));
    row.integer(static_cast<int64_t>(world.tracks.size()));
    row.real(world.scale_sigma);
    row.integer(world.guessed_keyframe);
    row.real(world.guessed_distance);
    row.real(world.rescaled);
    row.array(world.free_tracks);
    good = row.end_row();
  }
  return good;
}

bool write_keyframe(const MapKeyFrame& k, const KeyFrameSource& source, RowWriter& row) {
  std::vector<double> pose;
  append_pose(k.rig_from_world, &pose);
  const std::vector<double> rays = ray_numbers(k.rays);
  // Without the images, what a rolling shutter did to them says nothing any more.
  std::vector<Eigen::Vector2f> pixels;
  for (int f = 0; f < k.size(); ++f) pixels.push_back(k.instant_pixel(f));
  row.integer(k.frame);
  row.real(source.timestamp);
  row.text(source.image);
  row.array(pose);
  row.integer(k.size());
  row.array(k.cameras);
  row.array(pixels);
  row.array(k.octaves);
  row.array(k.tracks);
  row.array(k.inliers);
  row.array(rays);
  row.array(k.described);
  row.array(k.descriptors);
  return row.end_row();
}

bool write_keyframes(sqlite3* database, const SavedMap& map) {
  RowWriter row(database, "keyframe", 16);
  for (size_t w = 0; w < map.worlds.size(); ++w) {
    const SavedWorld& world = map.worlds[w];
    for (size_t k = 0; k < world.map.keyframes.size(); ++k) {
      row.integer(static_cast<int64_t>(w));
      row.integer(static_cast<int64_t>(k));
      if (!write_keyframe(world.map.keyframes[k], world.sources[k], row)) return false;
    }
  }
  return true;
}

// Tracks [begin, end), one array for each of their properties.
bool write_block(const Map& map, size_t begin, size_t end, RowWriter& row) {
  std::vector<double> positions;
  std::vector<uint8_t> flags, colors;
  std::vector<int> lengths;
  std::vector<TrackObservation> observations;
  for (size_t t = begin; t < end; ++t) {
    const Track& track = map.tracks[t];
    positions.insert(positions.end(), track.position.begin(), track.position.end());
    flags.push_back(static_cast<uint8_t>(track.triangulated | track.had_position << 1));
    colors.insert(colors.end(), track.rgb.begin(), track.rgb.end());
    lengths.push_back(static_cast<int>(track.observations.size()));
    observations.insert(observations.end(), track.observations.begin(), track.observations.end());
  }
  row.array(positions);
  row.array(flags);
  row.array(colors);
  row.array(lengths);
  row.array(observations);
  return row.end_row();
}

bool write_tracks(sqlite3* database, const SavedMap& map) {
  RowWriter row(database, "track_block", 8);
  for (size_t w = 0; w < map.worlds.size(); ++w) {
    const Map& world = map.worlds[w].map;
    for (size_t begin = 0; begin < world.tracks.size(); begin += kTracksInBlock) {
      row.integer(static_cast<int64_t>(w));
      row.integer(static_cast<int64_t>(begin / kTracksInBlock));
      if (!write_block(world, begin, std::min(world.tracks.size(), begin + kTracksInBlock), row))
        return false;
    }
  }
  return true;
}

Result<void> write_database(const SavedMap& map, const std::filesystem::path& file, const std::string& name) {
  Result<DatabaseHandle> database = create_map_database(file, name);
  if (!database) return database.error();
  sqlite3* const d = database->get();
  if (!write_rig(d, map) || !write_worlds(d, map) || !write_keyframes(d, map) || !write_tracks(d, map)) {
    return database_error(name, d);
  }
  return finish_map_database(*std::move(database), name);
}

}  // namespace

Result<void> keep_far_beside(const std::filesystem::path& map) {
  constexpr size_t kResident = size_t{128} << 20;
  return page_to(map.parent_path(), kResident);
}

Result<SavedMapWriter> SavedMapWriter::open(const std::filesystem::path& path) {
  if (path.has_parent_path()) {
    if (auto r = create_folder(path.parent_path()); !r) return r.error();
  }
  Result<FileLock> lock = FileLock::take(path);
  if (!lock) return lock.error();
  return SavedMapWriter(path, *std::move(lock));
}

Result<void> SavedMapWriter::write(const SavedMap& map) const {
  Result<void> good = check_saved_map(map);
  if (const auto rig = parse_camera_file(format_camera_file(map.rig), "cameras"); good && !rig)
    good = rig.error();
  if (!good) return internal_error(fmt::format("{}: not written: {}", path_.string(), good.error().message));
  return replace_file(path_, [&](const std::filesystem::path& temporary) {
    return write_database(map, temporary, path_.string());
  });
}

}  // namespace raysfm
