#include "raysfm/results/trajectory_file.h"

#include <gtest/gtest.h>

#include <string>

#include "raysfm/core/random.h"
#include "support/temporary_folder.h"

namespace raysfm {
namespace {

using testing_support::content_of;
using testing_support::TemporaryFolder;

class TrajectoryFile : public ::testing::Test {
 protected:
  // Reads `content`, which must be refused, and returns the message less the folder.
  std::string refusal(const std::string& content) {
    const Result<Trajectory> trajectory = read_trajectory(folder_.file("t.txt", content));
    if (trajectory.ok()) return "accepted";
    EXPECT_EQ(trajectory.error().kind, ErrorKind::kBadInput);
    EXPECT_EQ(trajectory.error().message.find('\n'), std::string::npos);
    const std::string prefix = folder_.path().string() + "/";
    EXPECT_EQ(trajectory.error().message.rfind(prefix, 0), 0u) << trajectory.error().message;
    return trajectory.error().message.substr(prefix.size());
  }

  Trajectory accepted(const std::filesystem::path& path) {
    const Result<Trajectory> trajectory = read_trajectory(path);
    if (!trajectory) ADD_FAILURE() << trajectory.error().message;
    return trajectory ? *trajectory : Trajectory{};
  }

  TemporaryFolder folder_;
};

TEST_F(TrajectoryFile, ReadsTum) {
  const Trajectory t = accepted(folder_.file(
      "t.txt",
      "# comment\n\n1.5 1 2 3 0 0 0.70710678118654752 0.70710678118654752\r\n  2.5\t4 5 6 0 0 0 -1"));
  ASSERT_EQ(t.size(), 2);
  EXPECT_EQ(t.timestamps[0], 1.5);
  EXPECT_EQ(t.world_from_cam[1].translation, Eigen::Vector3d(4, 5, 6));
  // A quarter turn about z takes x to y.
  EXPECT_LT((t.world_from_cam[0] * Eigen::Vector3d(1, 0, 0) - Eigen::Vector3d(1, 3, 3)).norm(), 1e-15);
}

TEST_F(TrajectoryFile, ReadsKittiWithTimesBesideIt) {
  const auto poses = folder_.file("poses.txt", "1 0 0 7 0 1 0 8 0 0 1 9\n0 -1 0 1 1 0 0 2 0 0 1 3\n");
  EXPECT_EQ(accepted(poses).timestamps, (std::vector<double>{0, 1}));
  folder_.file("times.txt", "0.25\n0.5\n");
  const Trajectory t = accepted(poses);
  EXPECT_EQ(t.timestamps, (std::vector<double>{0.25, 0.5}));
  EXPECT_LT((t.world_from_cam[1] * Eigen::Vector3d(1, 0, 0) - Eigen::Vector3d(1, 3, 3)).norm(), 1e-15);
}

// The first two lines of MH_01, and one as basalt writes them.
TEST_F(TrajectoryFile, ReadsEurocTruth) {
  const std::string text =
      "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z []\n"
      "1403636580838555648,4.688319,-1.786938,0.783338,0.534108,-0.153029,-0.827383,-0.082152,-0.027876,0."
      "033207,"
      "0.800006,-0.003172,0.021267,0.078502,-0.025266,0.136696,0.075593\n"
      "1403636580843555328, 1, 2, 3, 0.70710678118654752, 0, 0, 0.70710678118654752\r\n";
  const Trajectory t = accepted(folder_.file("data.csv", text));
  ASSERT_EQ(t.size(), 2);
  EXPECT_DOUBLE_EQ(t.timestamps[0], 1403636580.838555648);
  EXPECT_EQ(t.world_from_cam[0].translation, Eigen::Vector3d(4.688319, -1.786938, 0.783338));
  EXPECT_NEAR(t.world_from_cam[0].rotation.w(), 0.534108, 1e-6);
  EXPECT_NEAR(t.world_from_cam[0].rotation.y(), -0.827383, 1e-6);
  // A quarter turn about z takes x to y.
  EXPECT_LT((t.world_from_cam[1] * Eigen::Vector3d(1, 0, 0) - Eigen::Vector3d(1, 3, 3)).norm(), 1e-15);

  std::filesystem::create_directories(folder_.path() / "mav0" / "state_groundtruth_estimate0");
  folder_.file("mav0/state_groundtruth_estimate0/data.csv", text);
  EXPECT_EQ(accepted(folder_.path()).size(), 2);
  EXPECT_EQ(accepted(folder_.path() / "mav0").size(), 2);
}

TEST_F(TrajectoryFile, RefusesWrongEurocTruth) {
  EXPECT_EQ(refusal("1.5,1,2,3,1,0,0,0\n"),
            "t.txt:1: timestamp: '1.5' is not allowed, whole nanoseconds are");
  EXPECT_EQ(refusal("1,1,2,3,1,0,0\n"),
            "t.txt:1: 7 numbers are not allowed, at least 8 (timestamp, x, y, z, qw, qx, qy, qz) are");
  EXPECT_EQ(refusal("1,1,2,3,1,0,0,0\n2\n"),
            "t.txt:2: 1 numbers are not allowed, at least 8 (timestamp, x, y, z, qw, qx, qy, qz) are");
  EXPECT_EQ(refusal("1,nan,2,3,1,0,0,0\n"),
            "t.txt:1: field 2: 'nan' is not allowed, a number of at most 1e+12 is");
  EXPECT_EQ(refusal("1,1,2,3,0,0,0,0\n"),
            "t.txt:1: qw qx qy qz: a quaternion of length 0 is not allowed, 1 +- 0.001 is");
  EXPECT_EQ(refusal("2000000000,1,2,3,1,0,0,0\n1000000000,1,2,3,1,0,0,0\n"),
            "t.txt:2: timestamp: 1 is not allowed, it must be greater than 2 before it");
}

TEST_F(TrajectoryFile, FolderHoldsATrajectoryUnderAKnownName) {
  folder_.file("groundtruth.txt", "1 0 0 0 0 0 0 1\n");
  EXPECT_EQ(accepted(folder_.path()).timestamps, (std::vector<double>{1}));
  folder_.file("truth.txt", "2 0 0 0 0 0 0 1\n");
  EXPECT_EQ(accepted(folder_.path()).timestamps, (std::vector<double>{2}));
  folder_.file("trajectory.txt", "3 0 0 0 0 0 0 1\n");
  EXPECT_EQ(accepted(folder_.path()).timestamps, (std::vector<double>{3}));
}

TEST_F(TrajectoryFile, NormalisesARoundedQuaternion) {
  const Trajectory t = accepted(folder_.file("t.txt", "0 0 0 0 0 0 0 0.9995\n"));
  EXPECT_DOUBLE_EQ(t.world_from_cam[0].rotation.w(), 1.0);
}

TEST_F(TrajectoryFile, RefusesWithFileLineValueAndWhatIsAllowed) {
  EXPECT_EQ(refusal("0 0 0 0 0 0 0 1\n1 0 0 0 0 0 1\n"),
            "t.txt:2: 7 numbers are not allowed, 8 (timestamp tx ty tz qx qy qz qw) are");
  EXPECT_EQ(refusal("0 0 abc 0 0 0 0 1\n"),
            "t.txt:1: field 3: 'abc' is not allowed, a number of at most 1e+12 is");
  EXPECT_EQ(refusal("#\n0 0 0 nan 0 0 0 1\n"),
            "t.txt:2: field 4: 'nan' is not allowed, a number of at most 1e+12 is");
  EXPECT_EQ(refusal("0 0 0 inf 0 0 0 1\n").substr(0, 22), "t.txt:1: field 4: 'inf");
  EXPECT_EQ(refusal("0 0 0 1e400 0 0 0 1\n").substr(0, 22), "t.txt:1: field 4: '1e4");
  EXPECT_EQ(refusal("0 0 0 1x 0 0 0 1\n").substr(0, 21), "t.txt:1: field 4: '1x");
  EXPECT_EQ(refusal("0 0 0 0 0 0 0 0\n"),
            "t.txt:1: qx qy qz qw: a quaternion of length 0 is not allowed, 1 +- 0.001 is");
  EXPECT_EQ(refusal("0 0 0 0 0 0 0 1.01\n").substr(0, 40), "t.txt:1: qx qy qz qw: a quaternion of le");
  EXPECT_EQ(refusal("2 0 0 0 0 0 0 1\n2 0 0 0 0 0 0 1\n"),
            "t.txt:2: timestamp: 2 is not allowed, it must be greater than 2 before it");
  EXPECT_EQ(refusal("2 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n").substr(0, 21), "t.txt:2: timestamp: 1");
  EXPECT_EQ(refusal("# nothing\n"), "t.txt: no poses");
  EXPECT_EQ(refusal(""), "t.txt: no poses");
  EXPECT_EQ(refusal("1 0 0 0 0 1 0 0 0 0 2 0\n").substr(0, 10), "t.txt:1: R");
  EXPECT_EQ(refusal("1 0 0 0 0 1 0 0 0 0 -1 0\n").substr(0, 10), "t.txt:1: R");
  EXPECT_EQ(refusal("1 0 0 0 0 1 0 0 0 0 1 0\n0 0 0 0 0 0 0 1\n"),
            "t.txt:2: 8 numbers are not allowed, 12 (a 3 x 4 matrix by rows) are");
}

TEST_F(TrajectoryFile, RefusesTimesThatDoNotFit) {
  const auto poses = folder_.file("poses.txt", "1 0 0 7 0 1 0 8 0 0 1 9\n");
  folder_.file("times.txt", "1\n2\n");
  EXPECT_NE(read_trajectory(poses).error().message.find("2 timestamps are not allowed"), std::string::npos);
  folder_.file("times.txt", "1 2\n");
  EXPECT_NE(read_trajectory(poses).error().message.find("times.txt:1: 2 numbers"), std::string::npos);
}

TEST_F(TrajectoryFile, RefusesWhatIsNoFile) {
  EXPECT_NE(read_trajectory(folder_.path() / "missing").error().message.find("no such file"),
            std::string::npos);
  EXPECT_NE(read_trajectory(folder_.path()).error().message.find("no trajectory in this folder"),
            std::string::npos);
  EXPECT_FALSE(read_trajectory("/dev/zero").ok());
}

TEST_F(TrajectoryFile, SurvivesRandomBytes) {
  Rng rng(5);
  const std::string seed = "1.5 1 2 3 0 0 0.7071067 0.7071067\n2.5 4 5 6 0 0 0 -1\n3.5 4 5 6 0 0 0 1\n";
  for (int i = 0; i < 2000; ++i) {
    std::string content = seed;
    for (uint32_t k = rng.index(6); k > 0; --k)
      content[rng.index(content.size())] = static_cast<char>(rng.index(256));
    content.resize(rng.index(content.size() + 1));
    const Result<Trajectory> t = read_trajectory(folder_.file("t.txt", content));
    if (!t) continue;
    ASSERT_EQ(t->timestamps.size(), t->world_from_cam.size());
    for (const Rigid3& pose : t->world_from_cam) ASSERT_NEAR(pose.rotation.norm(), 1, 1e-9);
  }
}

TEST_F(TrajectoryFile, WritesWhatItReads) {
  Trajectory written;
  Rng rng(3);
  for (int i = 0; i < 50; ++i) {
    written.timestamps.push_back(1305031098.6659 + 0.033 * i);
    const Eigen::Vector3d t(rng.normal() * 1e-4, rng.normal(), rng.normal() * 1e4);
    written.world_from_cam.push_back({exp_so3({rng.normal(), rng.normal(), rng.normal()}), t});
  }
  const auto path = folder_.path() / "t.txt";
  ASSERT_TRUE(write_trajectory(written, "first line\nsecond line", path).ok());
  EXPECT_EQ(content_of(path).rfind("# first line\n# second line\n1305031098.66589", 0), 0u);
  const Trajectory read = accepted(path);
  ASSERT_EQ(read.size(), written.size());
  for (int i = 0; i < read.size(); ++i) {
    EXPECT_NEAR(read.timestamps[i], written.timestamps[i], 1e-6);
    const Eigen::Vector3d& t = written.world_from_cam[i].translation;
    EXPECT_LT((read.world_from_cam[i].translation - t).norm(), 1e-11 * t.norm());
    EXPECT_LT((read.world_from_cam[i].rotation.coeffs() - written.world_from_cam[i].rotation.coeffs()).norm(),
              1e-11);
  }
}

}  // namespace
}  // namespace raysfm
