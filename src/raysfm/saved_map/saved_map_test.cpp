#include "raysfm/saved_map/saved_map.h"

#include <gtest/gtest.h>
#include <signal.h>
#include <sqlite3.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cstring>
#include <functional>
#include <utility>

#include "raysfm/camera_files/camera_file.h"
#include "support/damage.h"
#include "support/random_saved_map.h"
#include "support/temporary_folder.h"

namespace raysfm {
namespace {

namespace fs = std::filesystem;
using testing_support::content_of;
using testing_support::random_saved_map;
using testing_support::TemporaryFolder;

template <typename Array>
bool same_bits(const Array& a, const Array& b) {
  return a.size() == b.size() &&
         (a.empty() || std::memcmp(a.data(), b.data(), a.size() * sizeof(*a.data())) == 0);
}

bool same_pose(const Rigid3& a, const Rigid3& b) {
  return a.rotation.coeffs() == b.rotation.coeffs() && a.translation == b.translation;
}

void expect_same(const MapKeyFrame& a, const MapKeyFrame& b) {
  EXPECT_EQ(a.frame, b.frame);
  EXPECT_TRUE(same_pose(a.rig_from_world, b.rig_from_world));
  EXPECT_TRUE(same_bits(a.cameras, b.cameras));
  EXPECT_TRUE(same_bits(a.pixels, b.pixels));
  EXPECT_TRUE(same_bits(a.octaves, b.octaves));
  EXPECT_TRUE(same_bits(a.tracks, b.tracks));
  EXPECT_TRUE(same_bits(a.inliers, b.inliers));
  EXPECT_TRUE(same_bits(a.rays, b.rays));
  EXPECT_TRUE(same_bits(a.described, b.described));
  EXPECT_TRUE(same_bits(a.descriptors, b.descriptors));
}

void expect_same(const Track& a, const Track& b) {
  EXPECT_EQ(a.position, b.position);
  EXPECT_EQ(a.triangulated, b.triangulated);
  EXPECT_EQ(a.had_position, b.had_position);
  EXPECT_EQ(a.rgb, b.rgb);
  EXPECT_TRUE(same_bits(a.observations, b.observations));
}

void expect_same(const SavedWorld& a, const SavedWorld& b) {
  EXPECT_EQ(a.map.scale_sigma, b.map.scale_sigma);
  EXPECT_EQ(a.map.guessed_keyframe, b.map.guessed_keyframe);
  EXPECT_EQ(a.map.guessed_distance, b.map.guessed_distance);
  EXPECT_EQ(a.map.rescaled, b.map.rescaled);
  EXPECT_EQ(a.map.free_tracks, b.map.free_tracks);
  ASSERT_EQ(a.sources.size(), b.sources.size());
  for (size_t k = 0; k < a.sources.size(); ++k) {
    EXPECT_EQ(a.sources[k].timestamp, b.sources[k].timestamp);
    EXPECT_EQ(a.sources[k].image, b.sources[k].image);
  }
  ASSERT_EQ(a.map.keyframes.size(), b.map.keyframes.size());
  for (size_t k = 0; k < a.map.keyframes.size(); ++k) expect_same(a.map.keyframes[k], b.map.keyframes[k]);
  ASSERT_EQ(a.map.tracks.size(), b.map.tracks.size());
  for (size_t t = 0; t < a.map.tracks.size(); ++t) expect_same(a.map.tracks[t], b.map.tracks[t]);
}

void expect_same(const SavedMap& a, const SavedMap& b) {
  EXPECT_EQ(format_camera_file(a.rig), format_camera_file(b.rig));
  for (size_t c = 0; c < a.rig.cameras.size(); ++c) {
    EXPECT_TRUE(same_pose(a.rig.cameras[c].rig_from_cam, b.rig.cameras[c].rig_from_cam));
  }
  ASSERT_EQ(a.worlds.size(), b.worlds.size());
  for (size_t w = 0; w < a.worlds.size(); ++w) expect_same(a.worlds[w], b.worlds[w]);
}

Result<void> write(const SavedMap& map, const fs::path& path) {
  const Result<SavedMapWriter> writer = SavedMapWriter::open(path);
  return writer ? writer->write(map) : writer.error();
}

// The file is refused by one line that names it and says all of `texts`.
void expect_refused(const fs::path& path, std::initializer_list<std::string> texts) {
  const Result<SavedMap> map = read_saved_map(path);
  ASSERT_FALSE(map);
  const Error& error = map.error();
  EXPECT_EQ(error.kind, ErrorKind::kBadInput);
  EXPECT_EQ(error.message.find('\n'), std::string::npos) << error.message;
  EXPECT_TRUE(error.message.starts_with(path.string())) << error.message;
  for (const std::string& text : texts)
    EXPECT_NE(error.message.find(text), std::string::npos) << error.message;
}

// Changes the file as any program could.
void execute(const fs::path& path, const std::string& sql) {
  sqlite3* database = nullptr;
  ASSERT_EQ(sqlite3_open(path.c_str(), &database), SQLITE_OK);
  ASSERT_EQ(sqlite3_exec(database, sql.c_str(), nullptr, nullptr, nullptr), SQLITE_OK)
      << sqlite3_errmsg(database);
  sqlite3_close(database);
}

TEST(SavedMap, ComesBackBitByBit) {
  const TemporaryFolder folder;
  const fs::path path = folder.path() / "a ?#%map.raysfm";
  const SavedMap saved = random_saved_map(1);
  ASSERT_TRUE(write(saved, path));
  const Result<SavedMap> read = read_saved_map(path);
  ASSERT_TRUE(read) << read.error().message;
  expect_same(saved, *read);
  EXPECT_EQ(std::distance(fs::directory_iterator(folder.path()), {}), 1);
}

TEST(SavedMap, HoldsTracksOfSeveralBlocks) {
  const TemporaryFolder folder;
  SavedMap saved = random_saved_map(2, 2, 9000);
  ASSERT_TRUE(write(saved, folder.path() / "map"));
  const Result<SavedMap> read = read_saved_map(folder.path() / "map");
  ASSERT_TRUE(read) << read.error().message;
  expect_same(saved, *read);
}

TEST(SavedMap, WritesTheSameBytesForTheSameMap) {
  const TemporaryFolder folder;
  ASSERT_TRUE(write(random_saved_map(3), folder.path() / "a"));
  ASSERT_TRUE(write(random_saved_map(4), folder.path() / "b"));
  ASSERT_TRUE(write(random_saved_map(3), folder.path() / "b"));
  EXPECT_EQ(content_of(folder.path() / "a"), content_of(folder.path() / "b"));
}

TEST(SavedMap, IsHeldByOneRun) {
  const TemporaryFolder folder;
  const fs::path path = folder.path() / "map", link = folder.path() / "link";
  fs::create_symlink(path, link);
  const SavedMap saved = random_saved_map(5);
  {
    const Result<SavedMapWriter> first = SavedMapWriter::open(path);
    ASSERT_TRUE(first);
    ASSERT_TRUE(first->write(saved));
    for (const fs::path& name : {path, link}) {
      const Result<SavedMapWriter> second = SavedMapWriter::open(name);
      ASSERT_FALSE(second);
      EXPECT_EQ(second.error().kind, ErrorKind::kBadInput);
      EXPECT_EQ(second.error().message, name.string() + ": held by another run; allowed: one at a time");
    }
    EXPECT_TRUE(read_saved_map(path));
    ASSERT_TRUE(first->write(random_saved_map(6)));
  }
  ASSERT_TRUE(write(saved, link));
  EXPECT_TRUE(fs::is_symlink(link));
  expect_same(saved, *read_saved_map(path));
}

TEST(SavedMap, SaysWhyAFileCannotBeWritten) {
  const TemporaryFolder folder;
  EXPECT_TRUE(SavedMapWriter::open(folder.path() / "new" / "map"));
  EXPECT_FALSE(SavedMapWriter::open(fs::path(folder.file("file", "")) / "map"));
  const Result<void> into_folder = write(random_saved_map(7), folder.path());
  ASSERT_FALSE(into_folder);
  EXPECT_EQ(into_folder.error().kind, ErrorKind::kBadInput);
  EXPECT_TRUE(into_folder.error().message.starts_with(folder.path().string())) << into_folder.error().message;
}

// Writes the two maps in turn and for ever, the second one first; each that is written is told to `told`.
[[noreturn]] void write_in_turn(const SavedMap (&maps)[2], const fs::path& path, int told) {
  for (int turn = 1;; ++turn) {
    if (!write(maps[turn % 2], path) || ::write(told, "w", 1) != 1) _exit(1);
  }
}

// Waits until the child has told of `writes` writes, and then for a part of the time that the last of them
// took.
void wait_into_a_write(int told, int writes, Rng* rng) {
  using Clock = std::chrono::steady_clock;
  Clock::time_point begin, end = Clock::now();
  for (int i = 0; i < writes; ++i) {
    char letter = 0;
    ASSERT_EQ(::read(told, &letter, 1), 1);
    begin = std::exchange(end, Clock::now());
  }
  const auto lasted = std::chrono::duration_cast<std::chrono::microseconds>(end - begin).count();
  usleep(static_cast<useconds_t>(rng->uniform() * static_cast<double>(lasted)));
}

// The child is killed in its second or in its third write: either map must have been found, whole, in the
// end.
TEST(SavedMap, SurvivesBeingKilled) {
  const TemporaryFolder folder;
  const fs::path path = folder.path() / "map";
  const SavedMap maps[] = {random_saved_map(8, 3, 2000), random_saved_map(9, 4, 2000)};
  ASSERT_TRUE(write(maps[0], path));
  Rng rng(10);
  int seen[2] = {0, 0};
  for (int i = 0; i < 20 || (seen[0] * seen[1] == 0 && i < 200); ++i) {
    int ends[2];
    ASSERT_EQ(pipe(ends), 0);
    const pid_t child = fork();
    if (child == 0) write_in_turn(maps, path, ends[1]);
    close(ends[1]);
    wait_into_a_write(ends[0], 1 + i % 2, &rng);
    close(ends[0]);
    ASSERT_EQ(kill(child, SIGKILL), 0);
    int status = 0;
    ASSERT_EQ(waitpid(child, &status, 0), child);
    ASSERT_TRUE(WIFSIGNALED(status));
    ASSERT_EQ(WTERMSIG(status), SIGKILL);
    const Result<SavedMap> read = read_saved_map(path);
    ASSERT_TRUE(read) << read.error().message;
    const bool second = read->worlds[0].map.keyframes.size() == 4;
    expect_same(maps[second], *read);
    ASSERT_FALSE(HasFailure());
    ++seen[second];
  }
  EXPECT_GT(seen[0], 0);
  EXPECT_GT(seen[1], 0);
  ASSERT_TRUE(write(maps[1], path));  // what the killed left holds nobody up
}

TEST(SavedMap, SaysWhatIsNoMap) {
  const TemporaryFolder folder;
  expect_refused(folder.path() / "none", {"no such file"});
  expect_refused(folder.path(), {"not a file"});
  expect_refused(folder.file("empty", ""), {"not a saved map"});
  expect_refused(folder.file("text", std::string(500, 'x')), {"not a saved map"});
  execute(folder.path() / "other", "CREATE TABLE a(b); INSERT INTO a VALUES (1);");
  expect_refused(folder.path() / "other", {"not a saved map"});
}

TEST(SavedMap, SaysThatItIsOfAnotherVersion) {
  const TemporaryFolder folder;
  const fs::path path = folder.path() / "map";
  ASSERT_TRUE(write(random_saved_map(11), path));
  execute(path, "PRAGMA user_version = 7");
  expect_refused(path, {"version 7", "allowed: version 1"});
}

TEST(SavedMap, SaysThatItIsCutOff) {
  const TemporaryFolder folder;
  ASSERT_TRUE(write(random_saved_map(12), folder.path() / "map"));
  const std::string whole = content_of(folder.path() / "map");
  for (size_t bytes = 0; bytes < whole.size(); bytes += 1 + whole.size() / 97) {
    const fs::path path = folder.file("cut", whole.substr(0, bytes));
    if (bytes >= 100) {
      expect_refused(path, {std::to_string(bytes) + " bytes, of " + std::to_string(whole.size())});
    } else {
      expect_refused(path, {"not a saved map"});
    }
  }
}

// Changes that leave every row with the right sum, and those that do not.
TEST(SavedMap, SaysWhichRowIsWrong) {
  const TemporaryFolder folder;
  const struct {
    const char* sql;
    std::initializer_list<std::string> says;
  } cases[] = {
      {"DELETE FROM keyframe WHERE world = 1 AND keyframe = 3", {"world 1, key frame 3", "missing"}},
      {"DELETE FROM keyframe WHERE world = 1 AND keyframe = 2", {"world 1, key frame 2", "keyframe: 3"}},
      {"DELETE FROM track_block WHERE world = 0", {"world 0, block 0", "world: 1", "0 to 0"}},
      {"DELETE FROM map", {"map", "missing"}},
      {"DELETE FROM world WHERE world = 2", {"world 2", "missing"}},
      {"UPDATE world SET world = 5 WHERE world = 2", {"world 2", "world: 5"}},
      {"UPDATE map SET worlds = 2", {"check_sum"}},
      {"UPDATE map SET worlds = -1", {"worlds: -1", "0 to"}},
      {"UPDATE world SET keyframes = 1 << 60", {"keyframes: 1152921504606846976"}},
      {"UPDATE world SET tracks = 900000000 WHERE world = 2", {"world 2", "check_sum"}},
      {"UPDATE keyframe SET features = features + 1", {"cameras", "bytes", "allowed: 51 of 1 bytes each"}},
      {"UPDATE keyframe SET pixels = zeroblob(7)", {"pixels: 7 bytes", "allowed: 50 of 8 bytes each"}},
      {"UPDATE keyframe SET rays = zeroblob(96)", {"rays: 12 elements", "allowed: 600"}},
      {"UPDATE keyframe SET descriptors = zeroblob(0)", {"descriptors: 0 bytes"}},
      {"UPDATE keyframe SET timestamp = timestamp + 1", {"check_sum"}},
      {"UPDATE keyframe SET image = image || 'x'", {"check_sum"}},
      {"UPDATE track_block SET flags = zeroblob(length(flags))", {"block 0 of tracks", "check_sum"}},
      {"UPDATE map SET cameras = 'hello'", {"check_sum"}},
      {"CREATE VIEW v AS SELECT 1", {"tables"}},
      {"CREATE TRIGGER t AFTER UPDATE ON map BEGIN SELECT 1; END", {"tables"}},
      {"CREATE INDEX i ON keyframe(frame)", {"tables"}},
      {"ALTER TABLE map ADD COLUMN more INTEGER", {"tables"}},
      {"DROP TABLE world; CREATE VIEW world AS SELECT 1", {"tables"}},
  };
  ASSERT_TRUE(write(random_saved_map(13), folder.path() / "good"));
  for (const auto& [sql, says] : cases) {
    const fs::path path = folder.path() / "map";
    fs::copy_file(folder.path() / "good", path, fs::copy_options::overwrite_existing);
    execute(path, sql);
    SCOPED_TRACE(sql);
    expect_refused(path, says);
  }
}

// tests/map_test.py makes files of such maps.
TEST(SavedMap, ChecksEveryNumber) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  constexpr double kInfinite = std::numeric_limits<double>::infinity();
  using Spoil = std::function<void(SavedMap&, Map&, MapKeyFrame&)>;
  const std::pair<Spoil, const char*> cases[] = {
      {[](SavedMap& m, Map&, MapKeyFrame&) { m.rig.cameras.clear(); }, "cameras"},
      {[](SavedMap& m, Map&, MapKeyFrame&) { m.rig.cameras[1].width = 0; }, "size"},
      {[](SavedMap& m, Map&, MapKeyFrame&) { m.rig.cameras[0].rig_from_cam.translation.x() = kNan; },
       "rig_from_cam"},
      {[](SavedMap& m, Map&, MapKeyFrame&) { m.worlds[1].sources.pop_back(); }, "sources"},
      {[](SavedMap& m, Map&, MapKeyFrame&) { m.worlds[1].sources[0].timestamp = kInfinite; }, "timestamp"},
      {[](SavedMap& m, Map&, MapKeyFrame&) { m.worlds[1].sources[0].image.resize(5000); }, "5000 bytes"},
      {[](SavedMap&, Map& m, MapKeyFrame&) { m.scale_sigma = kNan; }, "scale_sigma"},
      {[](SavedMap&, Map& m, MapKeyFrame&) { m.rescaled = 0; }, "rescaled"},
      {[](SavedMap&, Map& m, MapKeyFrame&) { m.guessed_distance = kNan; }, "guessed_distance"},
      {[](SavedMap&, Map& m, MapKeyFrame&) { m.guessed_keyframe = 4; }, "guessed_keyframe 4"},
      {[](SavedMap&, Map& m, MapKeyFrame&) { m.free_tracks.push_back(50); }, "free track 50"},
      {[](SavedMap&, Map& m, MapKeyFrame&) { m.free_tracks.push_back(m.free_tracks[0]); }, "free track"},
      {[](SavedMap&, Map& m, MapKeyFrame&) { m.free_tracks.push_back(0); }, "free track 0"},
      {[](SavedMap&, Map& m, MapKeyFrame&) {
         m.tracks[1].triangulated = true, m.tracks[1].position.y() = kNan;
       },
       "track 1: no position"},
      {[](SavedMap&, Map& m, MapKeyFrame&) { m.tracks[1].observations[0].keyframe = 4; }, "key frame 4"},
      {[](SavedMap&, Map& m, MapKeyFrame&) { m.tracks[1].observations[0].feature = -1; }, "feature -1"},
      {[](SavedMap&, Map& m, MapKeyFrame&) { m.tracks[1].observations[0].feature = 2; }, "names the track"},
      {[](SavedMap&, Map& m, MapKeyFrame&) {
         m.tracks[1].observations.push_back(m.tracks[1].observations.back());
       },
       "once"},
      {[](SavedMap&, Map& m, MapKeyFrame&) { m.tracks[1].observations.pop_back(); },
       "1 features name tracks"},
      {[](SavedMap&, Map&, MapKeyFrame& k) { k.frame = -1; }, "frame -1"},
      {[](SavedMap&, Map&, MapKeyFrame& k) { k.rig_from_world.rotation.w() += 0.01; }, "pose"},
      {[](SavedMap&, Map&, MapKeyFrame& k) { k.octaves.pop_back(); }, "sizes"},
      {[](SavedMap&, Map&, MapKeyFrame& k) { k.rays.pop_back(); }, "sizes"},
      {[](SavedMap&, Map&, MapKeyFrame& k) { k.cameras[3] = 2; }, "feature 3: camera 2"},
      {[](SavedMap&, Map&, MapKeyFrame& k) { k.pixels[3].x() = 1e9f; }, "feature 3: pixel"},
      {[](SavedMap&, Map&, MapKeyFrame& k) { k.pixels[3].y() = NAN; }, "feature 3: pixel"},
      {[](SavedMap&, Map&, MapKeyFrame& k) { k.octaves[3] = 31; }, "octave 31"},
      {[](SavedMap&, Map&, MapKeyFrame& k) { k.tracks[49] = -2; }, "track -2"},
      {[](SavedMap&, Map&, MapKeyFrame& k) { k.inliers[3] = 2; }, "inlier 2"},
      {[](SavedMap&, Map&, MapKeyFrame& k) { k.rays[3].direction *= 2; }, "ray"},
      {[](SavedMap&, Map&, MapKeyFrame& k) { k.rays[3].tangents(1, 1) = kNan; }, "ray"},
      {[](SavedMap&, Map&, MapKeyFrame& k) { std::swap(k.described[1], k.described[2]); }, "ascending"},
      {[](SavedMap&, Map&, MapKeyFrame& k) { k.described.back() = k.size(); }, "descriptor"},
      {[](SavedMap&, Map&, MapKeyFrame& k) { k.descriptors.pop_back(); }, "descriptors"},
  };
  for (const auto& [spoil, says] : cases) {
    SavedMap map = random_saved_map(14);
    ASSERT_TRUE(check_saved_map(map));
    spoil(map, map.worlds[1].map, map.worlds[1].map.keyframes[0]);
    const Result<void> checked = check_saved_map(map);
    ASSERT_FALSE(checked) << says;
    EXPECT_NE(checked.error().message.find(says), std::string::npos) << checked.error().message;
  }
}

TEST(SavedMap, KeepsTheOldFileWhereTheNewIsNoMap) {
  const TemporaryFolder folder;
  const fs::path path = folder.path() / "map";
  SavedMap map = random_saved_map(15);
  ASSERT_TRUE(write(map, path));
  const std::string before = content_of(path);
  for (const auto spoil : {+[](SavedMap* m) { m->rig.cameras[1].name = m->rig.cameras[0].name; },
                           +[](SavedMap* m) { m->worlds[0].map.rescaled = -1; }}) {
    spoil(&map);
    const Result<void> written = write(map, path);
    ASSERT_FALSE(written);
    EXPECT_EQ(written.error().kind, ErrorKind::kInternal);
    EXPECT_EQ(content_of(path), before);
  }
  EXPECT_EQ(std::distance(fs::directory_iterator(folder.path()), {}), 1);
}

TEST(SavedMap, KeepsTheOldFileWhereTheDiskIsFull) {
  const TemporaryFolder folder;
  const fs::path path = folder.path() / "map";
  ASSERT_TRUE(write(random_saved_map(15), path));
  const std::string before = content_of(path);
  const SavedMap large = random_saved_map(15, 3, 3000);
  rlimit unlimited{};
  getrlimit(RLIMIT_FSIZE, &unlimited);
  signal(SIGXFSZ, SIG_IGN);
  for (const rlim_t bytes : {0, 4096, 100'000}) {
    const rlimit limit{bytes, unlimited.rlim_max};
    setrlimit(RLIMIT_FSIZE, &limit);
    const Result<void> written = write(large, path);
    setrlimit(RLIMIT_FSIZE, &unlimited);
    ASSERT_FALSE(written) << bytes;
    EXPECT_EQ(written.error().kind, ErrorKind::kBadInput);
    EXPECT_TRUE(written.error().message.starts_with(path.string() + ": ")) << written.error().message;
    EXPECT_EQ(content_of(path), before);
    EXPECT_EQ(std::distance(fs::directory_iterator(folder.path()), {}), 1);
  }
}

// One line or a map that holds together. The sums see to it that damage to the rows is noticed.
TEST(SavedMap, SurvivesDamage) {
  const TemporaryFolder folder;
  const SavedMap saved = random_saved_map(16, 2, 12);
  ASSERT_TRUE(write(saved, folder.path() / "good"));
  const std::string whole = content_of(folder.path() / "good");
  const std::string pieces[] = {std::string(4, '\0'), std::string(4, '\xff'), "\x7f\xf0", "SQLite format 3"};
  Rng rng(17);
  int refused = 0, unchanged = 0;
  for (int i = 0; i < 600; ++i) {
    std::string broken = whole;
    if (i % 2 == 0) {
      broken[rng.index(static_cast<uint32_t>(whole.size()))] ^= static_cast<char>(1 << rng.index(8));
    } else {
      broken = testing_support::damaged(whole, pieces, rng);
      broken.resize(whole.size());
    }
    const Result<SavedMap> read = read_saved_map(folder.file("broken", broken));
    if (read) {
      ASSERT_TRUE(check_saved_map(*read));
      expect_same(saved, *read);
      ASSERT_FALSE(HasFailure()) << i;
      ++unchanged;
    } else {
      ASSERT_EQ(read.error().message.find('\n'), std::string::npos);
      ++refused;
    }
  }
  EXPECT_GT(refused, 200);
  EXPECT_GT(unchanged, 30);
}

}  // namespace
}  // namespace raysfm
