// Random damage to trajectories and to the folder of a result: whatever comes in, a reconstruction that holds
// together or one line comes out.
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <map>

#include "raysfm/core/random.h"
#include "raysfm/results/output_folder.h"
#include "raysfm/results/reconstruction_folder.h"
#include "raysfm/results/trajectory_file.h"
#include "support/damage.h"
#include "support/small_reconstruction.h"
#include "support/temporary_folder.h"

namespace raysfm {
namespace {

namespace fs = std::filesystem;
using testing_support::content_of;
using testing_support::damaged;
using testing_support::expect_line;
using testing_support::TemporaryFolder;

void expect_trajectory_or_line(const fs::path& path) {
  const Result<Trajectory> trajectory = read_trajectory(path);
  if (!trajectory) return expect_line(trajectory.error());
  ASSERT_EQ(trajectory->timestamps.size(), trajectory->world_from_cam.size());
  for (int i = 0; i < trajectory->size(); ++i) {
    if (i > 0) {
      ASSERT_LT(trajectory->timestamps[i - 1], trajectory->timestamps[i]);
    }
    ASSERT_TRUE(trajectory->world_from_cam[i].translation.allFinite());
    ASSERT_NEAR(trajectory->world_from_cam[i].rotation.norm(), 1, 1e-9);
  }
}

void expect_reconstruction_or_line(const fs::path& folder) {
  const Result<Reconstruction> r = read_reconstruction(folder);
  if (!r) return expect_line(r.error());
  for (const KeyFrame& keyframe : r->keyframes) {
    ASSERT_LT(static_cast<size_t>(keyframe.frame), r->frames.size());
    ASSERT_LE(static_cast<size_t>(keyframe.last_observation), r->observations.size());
  }
  for (const Observation& o : r->observations) {
    ASSERT_LT(static_cast<size_t>(o.point), r->points.size());
    ASSERT_LT(static_cast<size_t>(o.camera), r->rig.cameras.size());
  }
  for (const PosedFrame& frame : r->frames) {
    if (frame.world_from_rig) {
      ASSERT_TRUE(frame.world_from_rig->translation.allFinite());
    }
  }
}

using namespace std::string_literals;
const std::string kFolderPieces[] = {",",
                                     "\n",
                                     " ",
                                     "-1",
                                     "nan",
                                     "inf",
                                     "1e999",
                                     "99999999999999999999",
                                     "0x1",
                                     "#",
                                     "[",
                                     "]",
                                     "{",
                                     "}",
                                     ":",
                                     "null",
                                     "true",
                                     "\"",
                                     "\\",
                                     "\0"s,
                                     "[[",
                                     "1e12",
                                     "-1e12",
                                     "4294967296",
                                     "0 0 0",
                                     "\xff"s,
                                     "end_header\n",
                                     "\xff\xff\xff\x7f"s};

TEST(FolderFuzz, DamagedTrajectories) {
  const TemporaryFolder folder;
  const std::string texts[] = {"# world\n0.5 1 2 3 0 0 0 1\n1.5 1 2 4 0 0 0.6 0.8\n2 1 2 5 1 0 0 0\n",
                               "1 0 0 1 0 1 0 2 0 0 1 3\n1 0 0 2 0 1 0 2 0 0 1 3\n",
                               "#timestamp,x\n1403636579758555392,1,2,3,1,0,0,0,9\n"
                               "1403636579763555392,1,2,3,1,0,0,0,9\n"};
  Rng random(1);
  for (int i = 0; i < 6000; ++i) {
    const std::string broken = damaged(texts[i % 3], kFolderPieces, random);
    expect_trajectory_or_line(folder.file("t.txt", broken));
    ASSERT_FALSE(HasFatalFailure()) << broken;
  }
}

TEST(FolderFuzz, DamagedResults) {
  const TemporaryFolder folder;
  const fs::path out = folder.path() / "out";
  Reconstruction whole = testing_support::small_reconstruction({Pinhole{500, 510, 319.5, 239.5}});
  ASSERT_TRUE(write_output_folder(whole, Report{}, "seed: 1\n", out));
  ASSERT_TRUE(read_reconstruction(out));
  std::map<fs::path, std::string> files;
  for (const auto& entry : fs::recursive_directory_iterator(out)) {
    if (entry.is_regular_file()) files[entry.path()] = content_of(entry.path());
  }
  Rng random(2);
  for (const auto& [path, content] : files) {
    for (int i = 0; i < 150; ++i) {
      const std::string broken = damaged(content, kFolderPieces, random);
      std::ofstream(path, std::ios::binary) << broken;
      expect_reconstruction_or_line(out);
      ASSERT_FALSE(HasFatalFailure()) << path << " " << i;
    }
    std::ofstream(path, std::ios::binary) << content;
  }
}

}  // namespace
}  // namespace raysfm
