// Random damage to files of point tracks and of known structure: whatever comes in, consistent tracks or one
// line come out.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <set>

#include "raysfm/core/random.h"
#include "raysfm/results/tracks_file.h"
#include "support/damage.h"
#include "support/temporary_folder.h"

namespace raysfm {
namespace {

// Nothing in it moves the cursor of a terminal or ends the line early.
void expect_line_to_show(const Error& error) {
  testing_support::expect_line(error);
  ASSERT_TRUE(std::ranges::none_of(error.message, [](char c) { return c == '\0' || c == '\x1b'; }))
      << error.message;
}

void expect_tracks_or_line(const std::filesystem::path& path) {
  const Result<TracksFile> file = read_tracks_file(path);
  if (!file) return expect_line_to_show(file.error());
  ASSERT_EQ(file->image.size(), file->pixel.size());
  ASSERT_EQ(file->point.size(), file->pixel.size());
  ASSERT_EQ(file->timestamps.size(), file->images.size());
  for (size_t j = 1; j < file->timestamps.size(); ++j)
    ASSERT_LT(file->timestamps[j - 1], file->timestamps[j]);
  std::set<std::pair<int, int>> seen;
  for (size_t k = 0; k < file->pixel.size(); ++k) {
    ASSERT_LT(static_cast<size_t>(file->image[k]), file->images.size());
    ASSERT_LT(static_cast<size_t>(file->point[k]), file->points.size());
    ASSERT_TRUE(file->pixel[k].allFinite());
    ASSERT_TRUE(seen.emplace(file->image[k], file->point[k]).second);
  }
}

void expect_structure_or_line(const std::filesystem::path& path) {
  const Result<StructureFile> file = read_structure_file(path);
  if (!file) return expect_line_to_show(file.error());
  ASSERT_EQ(file->points.size(), file->positions.size());
  const std::set<std::string> names(file->points.begin(), file->points.end());
  ASSERT_EQ(names.size(), file->points.size());
  for (const Eigen::Vector3d& x : file->positions) ASSERT_TRUE(x.allFinite());
}

// Pieces that have a meaning in these formats.
using namespace std::string_literals;
const std::string kTrackPieces[] = {
    ",",   "\n",    "-1",   "nan",      "inf", "1e999", "99999999999999999999",
    "0x1", "#",     "\r\n", "\0"s,      "",    "1e6",   "-9223372036854775808",
    ",,",  "point", "\x1b", "\xff\xfe", " ",   "1e-300"};

TEST(TracksFuzz, DamagedFiles) {
  const testing_support::TemporaryFolder folder;
  const std::filesystem::path path = folder.path() / "fuzz.csv";
  Rng random(1);
  for (int i = 0; i < 4000; ++i) {
    const bool tracks = i % 2 == 0;
    const std::string broken =
        testing_support::damaged(tracks ? "image,point,u,v\n0,a,1.5,2\n# c\n0,b,3,-4\n1,a,5,6\n10,b,7e1,8\n"
                                        : "point,x,y,z\na,1,2,3\nb,-1.5,0,1e3\n7,0,0,0\n",
                                 kTrackPieces, random);
    std::ofstream(path, std::ios::binary) << broken;
    tracks ? expect_tracks_or_line(path) : expect_structure_or_line(path);
    ASSERT_FALSE(HasFatalFailure()) << broken;
  }
}

TEST(TracksFuzz, RandomBytes) {
  const testing_support::TemporaryFolder folder;
  const std::filesystem::path path = folder.path() / "fuzz.csv";
  Rng random(2);
  for (int i = 0; i < 1000; ++i) {
    std::string content = i % 2 ? "image,point,u,v\n" : "";
    for (uint32_t length = random.index(200); length > 0; --length) {
      content += static_cast<char>(random.index(256));
    }
    std::ofstream(path, std::ios::binary) << content;
    expect_tracks_or_line(path);
    expect_structure_or_line(path);
    ASSERT_FALSE(HasFatalFailure());
  }
}

TEST(TracksFuzz, ExtremeNumbersAreNamesOrRefused) {
  const testing_support::TemporaryFolder folder;
  const std::filesystem::path path = folder.path() / "huge.csv";
  std::ofstream(path) << "image,point,u,v\n99999999999999999999,18446744073709551616,1,2\n-5,7,3,4\n";
  const auto file = read_tracks_file(path);
  ASSERT_TRUE(file.ok()) << file.error().message;
  EXPECT_EQ(file->images.size(), 2u);
  EXPECT_EQ(file->timestamps, (std::vector<double>{0, 1}));
}

}  // namespace
}  // namespace raysfm
