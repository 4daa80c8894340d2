// What a command gives is what its folder gives back.
#include <gtest/gtest.h>

#include "raysfm/adjustment/adjust.h"
#include "raysfm/api/solve.h"
#include "raysfm/api/track.h"
#include "raysfm/results/output_folder.h"
#include "raysfm/results/reconstruction_folder.h"
#include "raysfm/results/trajectory_file.h"
#include "raysfm/settings/config.h"
#include "support/shared_data.h"
#include "support/temporary_folder.h"

namespace raysfm {
namespace {

namespace fs = std::filesystem;
using testing_support::shared_data;
using testing_support::TemporaryFolder;

void expect_same_frames(const Reconstruction& read, const Reconstruction& made) {
  ASSERT_EQ(read.frames.size(), made.frames.size());
  for (size_t i = 0; i < made.frames.size(); ++i) {
    const PosedFrame &a = read.frames[i], &b = made.frames[i];
    EXPECT_EQ(a.timestamp, b.timestamp);
    EXPECT_EQ(a.reason, b.reason);
    EXPECT_EQ(a.segment, b.segment);
    EXPECT_EQ(a.lens, b.lens);
    ASSERT_EQ(a.world_from_rig.has_value(), b.world_from_rig.has_value());
    if (!b.world_from_rig) continue;
    EXPECT_EQ(a.world_from_rig->rotation.coeffs(), b.world_from_rig->rotation.coeffs());
    EXPECT_EQ(a.world_from_rig->translation, b.world_from_rig->translation);
    for (int row = 0; row < 6; ++row) {  // the upper triangle is what is written
      for (int column = row; column < 6; ++column) {
        EXPECT_EQ(a.covariance(row, column), b.covariance(row, column));
      }
    }
  }
}

void expect_same(const Reconstruction& read, const Reconstruction& made) {
  expect_same_frames(read, made);
  EXPECT_EQ(read.origin, made.origin);
  EXPECT_EQ(read.rms_reprojection_px, made.rms_reprojection_px);
  ASSERT_EQ(read.keyframes.size(), made.keyframes.size());
  for (size_t k = 0; k < made.keyframes.size(); ++k) {
    EXPECT_EQ(read.keyframes[k].frame, made.keyframes[k].frame);
    EXPECT_EQ(read.keyframes[k].last_observation, made.keyframes[k].last_observation);
  }
  ASSERT_EQ(read.observations.size(), made.observations.size());
  ASSERT_EQ(read.points.size(), made.points.size());
  for (size_t i = 0; i < made.observations.size(); ++i) {
    const Observation &a = read.observations[i], &b = made.observations[i];
    ASSERT_EQ(a.point, b.point);
    ASSERT_EQ(read.points[a.point].position, made.points[b.point].position);
    ASSERT_LT((a.pixel - b.pixel).norm(), 1e-12);
  }
  ASSERT_EQ(read.lenses.size(), made.lenses.size());
  for (size_t i = 0; i < made.lenses.size(); ++i) {
    EXPECT_EQ(lens_of(read.lenses[i])->vector(), lens_of(made.lenses[i])->vector());
    EXPECT_EQ(read.lenses[i].sigma, made.lenses[i].sigma);
  }
}

void expect_read_back(const fs::path& folder, const Reconstruction& made) {
  const Result<Reconstruction> read = read_reconstruction(folder);
  ASSERT_TRUE(read.ok()) << read.error().message;
  expect_same(*read, made);
}

TEST(ReadBack, Track) {
  RAYSFM_SKIP_WITHOUT_SHARED_DATA("redkitchen-handheld");
  const TemporaryFolder folder;
  TrackSettings settings;
  settings.inputs = {shared_data("redkitchen-handheld").string()};
  const Result<TrackResult> made = track(settings, {});
  ASSERT_TRUE(made.ok()) << made.error().message;
  ASSERT_TRUE(write_output_folder(made->reconstruction, made->report, "", folder.path()).ok());
  expect_read_back(folder.path(), made->reconstruction);
}

TEST(ReadBack, SolveOfAZoomingLens) {
  RAYSFM_SKIP_WITHOUT_SHARED_DATA("zoom-tsukuba");
  const TemporaryFolder folder;
  SolveSettings settings;
  settings.input = shared_data("zoom-tsukuba").string();
  const Result<SolveResult> made = solve(settings, {});
  ASSERT_TRUE(made.ok()) << made.error().message;
  EXPECT_EQ(made->reconstruction.lenses.size(), made->reconstruction.frames.size());
  ASSERT_TRUE(write_solve_output(*made, settings, "0", folder.path()).ok());
  expect_read_back(folder.path(), made->reconstruction);
}

// Three photos of the temple see nothing of what the other six see: a world of their own.
TEST(ReadBack, SolveOfPhotosThatFallApart) {
  RAYSFM_SKIP_WITHOUT_SHARED_DATA("temple-ring");
  const TemporaryFolder folder;
  SolveSettings settings;
  settings.input = (folder.path() / "photos").string();
  settings.images = "photos";
  fs::create_directories(settings.input);
  const std::vector<int> numbers = {13, 14, 15, 23, 24, 25, 27, 29, 31};
  for (const int n : numbers)
    fs::copy(shared_data("temple-ring/images/templeR00" + std::to_string(n) + ".png"), settings.input);
  const Result<SolveResult> made = solve(settings, {});
  ASSERT_TRUE(made.ok()) << made.error().message;
  const Reconstruction& r = made->reconstruction;
  ASSERT_EQ(r.segments.size(), 2u);
  EXPECT_EQ(r.lenses.size(), 1u);
  const Result<Trajectory> truth = read_trajectory(shared_data("temple-ring/truth.txt"));
  ASSERT_TRUE(truth.ok());
  const auto true_pose = [&](size_t frame) { return truth->world_from_cam[numbers[frame] - 13]; };
  for (size_t j = 0; j < r.frames.size(); ++j) {
    ASSERT_TRUE(r.frames[j].world_from_rig) << j;
    EXPECT_EQ(r.frames[j].segment, j < 3 ? 1 : 0) << j;
    const size_t first = j < 3 ? 0 : 3;
    const Rigid3 turned = r.frames[first].world_from_rig->inverse() * *r.frames[j].world_from_rig;
    const Rigid3 expected = true_pose(first).inverse() * true_pose(j);
    EXPECT_LT(turned.rotation.angularDistance(expected.rotation), 0.02) << j;  // the gantry's 1.1 degrees
  }
  const fs::path out = folder.path() / "out";
  ASSERT_TRUE(write_solve_output(*made, settings, "0", out).ok());
  EXPECT_TRUE(fs::is_directory(out / "worlds/1/sparse"));
  expect_read_back(out, r);
}

TEST(ReadBack, Adjust) {
  RAYSFM_SKIP_WITHOUT_SHARED_DATA("bal");
  const TemporaryFolder folder;
  AdjustSettings settings;
  settings.input = shared_data("bal").string() + "/problem-49-7776-pre.txt.bz2";
  settings.max_iterations = 2;
  const Result<AdjustResult> made = adjust(settings, {});
  ASSERT_TRUE(made.ok()) << made.error().message;
  ASSERT_TRUE(write_adjust_output(*made, settings, "0", folder.path()).ok());
  expect_read_back(folder.path(), made->reconstruction);
}

}  // namespace
}  // namespace raysfm
