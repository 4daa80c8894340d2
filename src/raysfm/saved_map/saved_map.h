#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "raysfm/camera/camera.h"
#include "raysfm/core/result.h"
#include "raysfm/files/file_lock.h"
#include "raysfm/scene/map.h"

namespace raysfm {

// Of the files that are written; no other is read. docs/saved_map.md describes it.
constexpr int kSavedMapVersion = 1;

constexpr size_t kLongestImageName = 4096;  // bytes

// What a key frame was taken from.
struct KeyFrameSource {
  double timestamp = 0;  // seconds
  std::string image;     // name of the first camera's; empty where it has none
};

// A world, with the source of each of its key frames.
struct SavedWorld {
  Map map;
  std::vector<KeyFrameSource> sources;
};

// What later runs go on with: everything but images.
struct SavedMap {
  Rig rig;
  std::vector<SavedWorld> worlds;
};

// Whether every index, count and number of the map is one that the map's users can rely on: indices in range,
// tracks and features that name each other, poses and rays of unit rotations and directions, finite numbers.
// Errors: bad input, which does not name a file.
Result<void> check_saved_map(const SavedMap& map);

// Reads a file of anybody's: nothing in it is believed before it is checked, and nothing in it is executed.
// Errors: bad input, one line with file, place, value and what is allowed.
Result<SavedMap> read_saved_map(const std::filesystem::path& path);

// From now on, of the maps of this process and of what adjusts them, what is far lies in a file beside a map
// that is to be written (core/paged_memory.h): 128 MiB of it stay in memory. The folder must be there.
// Error: internal, where that cannot be, which changes nothing but the memory that a run takes.
Result<void> keep_far_beside(const std::filesystem::path& map);

// Holds a file for this run alone, from before it is read until the last time that it is written, so that no
// run takes back what another has added.
class SavedMapWriter {
 public:
  // Neither the file nor its folder need be there. Errors: bad input, where another run holds it or its
  // folder cannot be written.
  static Result<SavedMapWriter> open(const std::filesystem::path& path);

  // Replaces the file as a whole: whatever ends the program, it is the old one or the new one. Errors:
  // internal where the map is not as check_saved_map() or the cameras not as a camera file wants them; bad
  // input where the file cannot be written.
  Result<void> write(const SavedMap& map) const;

 private:
  SavedMapWriter(std::filesystem::path path, FileLock lock)
      : path_(std::move(path)), lock_(std::move(lock)) {}

  std::filesystem::path path_;
  FileLock lock_;
};

}  // namespace raysfm
