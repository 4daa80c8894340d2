#include "raysfm/colmap_bal/bal_file.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <ctime>

#include "raysfm/core/random.h"
#include "raysfm/files/bzip2.h"
#include "support/shared_data.h"
#include "support/temporary_folder.h"

namespace raysfm {
namespace {

using testing_support::content_of;
using testing_support::shared_data;
using testing_support::TemporaryFolder;

// Two cameras, three points, four observations, with the white space of the published problems.
const std::string kSmall =
    "2 3 4\n"
    "0 0     -3.326500e+02 2.620900e+02\n"
    "1 0     1.5 -2\n"
    "0 1\t.25 1e-3\r\n"
    "1 2 7 8\n"
    "1.5741515942940262e-02\n-1.2790936163850642e-02\n-4.4008498081980789e-03\n"
    "-3.4093839577186584e-02\n-1.0751387104921525e-01\n1.1202240291236032e+00\n"
    "3.9975152639358436e+02\n-3.1770643852803579e-07\n5.8820490534594022e-13\n"
    "1 2 3 4 5 6 7 8 9\n"
    "-6.1200015717226364e-01\n5.7175904776028286e-01\n-1.8470812764548823e+00\n"
    "1 2 3 4 5 6\n";

std::string bal_refusal(const std::string& text) {
  const Result<BalFile> file = parse_bal(text, "file");
  if (file) return "accepted";
  EXPECT_EQ(file.error().kind, ErrorKind::kBadInput);
  EXPECT_EQ(file.error().message.find('\n'), std::string::npos);
  return file.error().message;
}

std::string replaced(std::string text, const std::string& from, const std::string& to) {
  const size_t at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  return text.replace(at, from.size(), to);
}

TEST(BalFile, ReadsEveryNumber) {
  const Result<BalFile> file = parse_bal(kSmall, "file");
  ASSERT_TRUE(file) << file.error().message;
  ASSERT_EQ(file->cameras.size(), 2u);
  ASSERT_EQ(file->points.size(), 3u);
  ASSERT_EQ(file->observations.size(), 4u);
  EXPECT_EQ(file->observations[0].pixel, Eigen::Vector2d(-332.65, 262.09));
  EXPECT_EQ(file->observations[2].camera, 0);
  EXPECT_EQ(file->observations[2].point, 1);
  EXPECT_EQ(file->observations[2].pixel, Eigen::Vector2d(0.25, 0.001));
  EXPECT_EQ(file->cameras[0][6], 3.9975152639358436e+02);
  EXPECT_EQ(file->cameras[1], (std::array<double, 9>{1, 2, 3, 4, 5, 6, 7, 8, 9}));
  EXPECT_EQ(file->points[0].x(), -6.1200015717226364e-01);
  EXPECT_EQ(file->points[2], Eigen::Vector3d(4, 5, 6));
}

bool same_bits(const BalFile& a, const BalFile& b) {
  bool same =
      a.cameras == b.cameras && a.points == b.points && a.observations.size() == b.observations.size();
  for (size_t i = 0; same && i < a.observations.size(); ++i) {
    const BalObservation &p = a.observations[i], &q = b.observations[i];
    same = p.camera == q.camera && p.point == q.point && p.pixel == q.pixel;
  }
  return same;
}

BalFile random_file(int cameras, int points, int observations) {
  Rng random(4);
  BalFile file;
  file.cameras.resize(cameras);
  file.points.resize(points);
  for (auto& camera : file.cameras) {
    for (double& number : camera) number = random.normal() * std::pow(10.0, random.uniform(-300, 3));
    camera[6] = std::abs(camera[6]);  // f
  }
  for (Eigen::Vector3d& point : file.points) point = {random.normal(), random.normal(), random.normal()};
  for (int i = 0; i < observations; ++i) {
    file.observations.push_back({static_cast<int>(random.index(cameras)),
                                 static_cast<int>(random.index(points)),
                                 {1000 * random.normal(), 1000 * random.normal()}});
  }
  return file;
}

TEST(BalFile, WritesWhatItReadsPlainAndPacked) {
  const TemporaryFolder folder;
  BalFile file = random_file(5, 40, 100);
  for (const bool compressed : {false, true}) {
    file.compressed = compressed;
    const auto path = folder.path() / "problem";
    ASSERT_TRUE(write_bal_file(file, path));
    EXPECT_EQ(is_bzip2(content_of(path)), compressed);
    const Result<BalFile> read = read_bal_file(path);
    ASSERT_TRUE(read) << read.error().message;
    EXPECT_EQ(read->compressed, compressed);
    EXPECT_TRUE(same_bits(*read, file));
  }
}

// The published initial cost of Ladybug 49, with the projection written down as on the data set's page.
TEST(BalFile, Ladybug) {
  RAYSFM_SKIP_WITHOUT_SHARED_DATA("bal/problem-49-7776-pre.txt.bz2");
  const Result<BalFile> file = read_bal_file(shared_data("bal/problem-49-7776-pre.txt.bz2"));
  ASSERT_TRUE(file) << file.error().message;
  EXPECT_TRUE(file->compressed);
  ASSERT_EQ(file->cameras.size(), 49u);
  ASSERT_EQ(file->points.size(), 7776u);
  ASSERT_EQ(file->observations.size(), 31843u);
  double cost = 0;
  for (const BalObservation& o : file->observations) {
    const auto& c = file->cameras[o.camera];
    const Eigen::Vector3d axis(c[0], c[1], c[2]);
    const Eigen::Vector3d p = Eigen::AngleAxisd(axis.norm(), axis.normalized()) * file->points[o.point] +
                              Eigen::Vector3d(c[3], c[4], c[5]);
    const Eigen::Vector2d n = -p.head<2>() / p.z();
    const double q = n.squaredNorm();
    cost += 0.5 * (c[6] * (1 + c[7] * q + c[8] * q * q) * n - o.pixel).squaredNorm();
  }
  EXPECT_NEAR(cost, 8.5091e5, 5);
}

TEST(BalFile, ReadsQuickly) {
  const std::string text = format_bal(random_file(100, 50000, 200000));
  const std::clock_t start = std::clock();
  ASSERT_TRUE(parse_bal(text, "file"));
  const double seconds = static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC;  // of the processor
  EXPECT_GT(static_cast<double>(text.size()) / seconds, 10e6) << text.size() << " bytes, " << seconds << " s";
}

TEST(BalFile, CountsThatLie) {
  EXPECT_EQ(
      bal_refusal("2000000000 2000000000 2000000000 0 0 1 2"),
      "file:1: 2000000000 cameras, 2000000000 points and 2000000000 observations are not allowed, they need "
      "at least 64000000000 bytes and 8 follow");
  EXPECT_EQ(bal_refusal(replaced(kSmall, "2 3 4", "2 3 5")),
            "file:6: observation 4: camera: '1.5741515942940262e-02' is not allowed, a whole number from 0 "
            "to 1 is");
  EXPECT_EQ(bal_refusal(replaced(kSmall, "2 3 4", "2 4 4")), "file:20: the file ends before point 3: x");
  EXPECT_EQ(bal_refusal(replaced(kSmall, "2 3 4", "2 2 4")),
            "file:5: observation 3: point: '2' is not allowed, a whole number from 0 to 1 is");
  EXPECT_EQ(bal_refusal(replaced(kSmall, "2 3 4", "2 3 -4")),
            "file:1: number of observations: '-4' is not allowed, a whole number from 0 to 2147483646 is");
  EXPECT_EQ(bal_refusal("99999999999999999999 1 1"),
            "file:1: number of cameras: '99999999999999999999' is not allowed, a whole number from 0 to "
            "2147483646 is");
  EXPECT_EQ(bal_refusal("1 1.5 1"),
            "file:1: number of points: '1.5' is not allowed, a whole number from 0 to 2147483646 is");
  EXPECT_EQ(bal_refusal(""), "file:1: the file ends before number of cameras");
}

TEST(BalFile, NumbersThatAreNone) {
  for (const char* number : {"nan", "inf", "-inf", "1e999", "1.2.3", "0x10", "abc", "1,5"}) {
    EXPECT_EQ(bal_refusal(replaced(kSmall, "1e-3", number)),
              "file:4: observation 2: y: '" + std::string(number) +
                  "' is not allowed, a number from -1e+06 to 1e+06 is");
  }
  EXPECT_EQ(bal_refusal(replaced(kSmall, "3.9975152639358436e+02", "nan")),
            "file:12: camera 0: f: 'nan' is not allowed, a number above 0, up to 1e+07 is");
  EXPECT_EQ(bal_refusal(replaced(kSmall, "-1.8470812764548823e+00", "nan")),
            "file:18: point 0: z: 'nan' is not allowed, a number from -1e+12 to 1e+12 is");
}

// Finite, but no photograph is behind them: their squares overflow, or a pixel divides by them.
TEST(BalFile, NumbersBeyondWhatIsAllowed) {
  for (const char* f : {"0", "-0", "-400", "1.1e7", "1e300"}) {
    EXPECT_EQ(
        bal_refusal(replaced(kSmall, "3.9975152639358436e+02", f)),
        "file:12: camera 0: f: '" + std::string(f) + "' is not allowed, a number above 0, up to 1e+07 is");
  }
  EXPECT_EQ(bal_refusal(replaced(kSmall, "1e-3", "1e308")),
            "file:4: observation 2: y: '1e308' is not allowed, a number from -1e+06 to 1e+06 is");
  EXPECT_EQ(bal_refusal(replaced(kSmall, "1.5741515942940262e-02", "-1e5")),
            "file:6: camera 0: rotation x: '-1e5' is not allowed, a number from -10000 to 10000 is");
  EXPECT_EQ(bal_refusal(replaced(kSmall, "1.1202240291236032e+00", "1e300")),
            "file:11: camera 0: translation z: '1e300' is not allowed, a number from -1e+12 to 1e+12 is");
  EXPECT_EQ(bal_refusal(replaced(kSmall, "5.8820490534594022e-13", "1e13")),
            "file:14: camera 0: k2: '1e13' is not allowed, a number from -1e+12 to 1e+12 is");
  EXPECT_EQ(bal_refusal(replaced(kSmall, "-6.1200015717226364e-01", "1e300")),
            "file:16: point 0: x: '1e300' is not allowed, a number from -1e+12 to 1e+12 is");
  EXPECT_EQ(bal_refusal(replaced(kSmall, "1e-3", "-1e6")), "accepted");
}

TEST(BalFile, IndicesOutOfRange) {
  EXPECT_EQ(bal_refusal(replaced(kSmall, "1 2 7 8", "2 2 7 8")),
            "file:5: observation 3: camera: '2' is not allowed, a whole number from 0 to 1 is");
  EXPECT_EQ(bal_refusal(replaced(kSmall, "1 2 7 8", "1 3 7 8")),
            "file:5: observation 3: point: '3' is not allowed, a whole number from 0 to 2 is");
  EXPECT_EQ(bal_refusal(replaced(kSmall, "1 2 7 8", "1 -1 7 8")),
            "file:5: observation 3: point: '-1' is not allowed, a whole number from 0 to 2 is");
}

TEST(BalFile, CutOffAnywhereAndTrailingGarbage) {
  // A number that is cut short is still a number: up to the last digit but one.
  for (size_t length = 0; length + 2 < kSmall.size(); ++length) {
    EXPECT_NE(bal_refusal(kSmall.substr(0, length)), "accepted") << length;
  }
  EXPECT_EQ(bal_refusal(kSmall + " \n\n\t"), "accepted");
  EXPECT_EQ(bal_refusal(kSmall + "end"), "file:20: 'end' is not allowed, the file ends after the last point");
}

TEST(BalFile, PackedFilesThatAreDamagedOrBombs) {
  const TemporaryFolder folder;
  const auto message = [&](const std::string& bytes) {
    const auto path = folder.file("p.bz2", bytes);
    const Result<BalFile> file = read_bal_file(path);
    return file ? "accepted" : file.error().message.substr(path.string().size());
  };
  const std::string packed = compress_bzip2(kSmall);
  EXPECT_EQ(message(packed), "accepted");
  EXPECT_EQ(message(packed.substr(0, packed.size() - 1)), ": cut off, the end of the bzip2 data is missing");
  EXPECT_EQ(message(packed + "x"), ": damaged, what follows is no bzip2 data");
  EXPECT_EQ(message(compress_bzip2(std::string(size_t{64} << 20, ' '))).substr(0, 22),
            ": unpacks to more than");
  EXPECT_EQ(read_bal_file(folder.path() / "missing").error().message,
            (folder.path() / "missing").string() + ": no such file");
  EXPECT_FALSE(read_bal_file("/dev/zero").ok());
}

}  // namespace
}  // namespace raysfm
