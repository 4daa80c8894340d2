#include "raysfm/results/reconstruction_folder.h"

#include <gtest/gtest.h>

#include <cmath>

#include "raysfm/results/output_folder.h"
#include "support/small_reconstruction.h"
#include "support/temporary_folder.h"

namespace raysfm {
namespace {

namespace fs = std::filesystem;
using testing_support::small_reconstruction;
using testing_support::TemporaryFolder;

// Numbers that no fixed count of digits holds, in one world or in two.
Reconstruction uneven_reconstruction(int cameras, bool two_worlds) {
  Reconstruction r =
      small_reconstruction(std::vector<CameraModel>(cameras, Pinhole{500.0 + 1.0 / 3, 510, 319.5, 239.5}));
  Rng rng(5);
  for (size_t i = 0; i < r.frames.size(); ++i) {
    PosedFrame& frame = r.frames[i];
    frame.timestamp = (static_cast<double>(i) + 1) / 3;
    if (!frame.world_from_rig) continue;
    for (int j = 0; j < 6; ++j) frame.covariance(j, j) = rng.uniform() * 1e-7;
    frame.world_from_rig->rotation.normalize();
  }
  r.rms_reprojection_px = 1.0 / 7;
  r.metric_scale = r.segments[0].metric_scale = true;
  r.scale_sigma = r.segments[0].scale_sigma = 0.25;
  if (!two_worlds) return r;
  r.segments = {{0, 2, "track lost", false, 0.5}, {3, 11, "end of input", true, 0.25}};
  r.starts = {{"five-point", {0, 1, 2}, 20}, {"pless", {3, 6, 9}, 30}};
  for (int i = 3; i < 12; ++i) {
    if (r.frames[i].world_from_rig) r.frames[i].segment = 1;
  }
  // Points in the order of their worlds, and none seen from another.
  for (size_t i = 100; i < 200; ++i) r.points[i].segment = 1;
  std::vector<Observation> kept;
  for (KeyFrame& k : r.keyframes) {
    const auto first = static_cast<int>(kept.size());
    for (int i = k.first_observation; i < k.last_observation; ++i) {
      if (r.points[r.observations[i].point].segment != r.frames[k.frame].segment) continue;
      kept.push_back(r.observations[i]);
    }
    k.first_observation = first;
    k.last_observation = static_cast<int>(kept.size());
  }
  r.observations = kept;
  return r;
}

void expect_same_frames(const Reconstruction& read, const Reconstruction& r) {
  ASSERT_EQ(read.frames.size(), r.frames.size());
  for (size_t i = 0; i < r.frames.size(); ++i) {
    const PosedFrame &a = read.frames[i], &b = r.frames[i];
    EXPECT_EQ(a.timestamp, b.timestamp);
    EXPECT_EQ(a.segment, b.segment);
    EXPECT_EQ(a.reason, b.reason);
    ASSERT_EQ(a.world_from_rig.has_value(), b.world_from_rig.has_value());
    if (!b.world_from_rig) continue;
    EXPECT_EQ(a.world_from_rig->translation, b.world_from_rig->translation);
    EXPECT_EQ(a.world_from_rig->rotation.coeffs(), b.world_from_rig->rotation.coeffs());
    EXPECT_EQ(a.covariance, b.covariance);
  }
}

void expect_same_map(const Reconstruction& read, const Reconstruction& r) {
  ASSERT_EQ(read.points.size(), r.points.size());
  std::vector<bool> seen(r.points.size(), false);
  for (const Observation& o : r.observations) seen[o.point] = true;
  for (size_t i = 0; i < r.points.size(); ++i) {
    if (seen[i]) {
      EXPECT_EQ(read.points[i].position, r.points[i].position);
    }
    EXPECT_EQ(read.points[i].position.cast<float>(), r.points[i].position.cast<float>());
    EXPECT_EQ(read.points[i].rgb, r.points[i].rgb);
    EXPECT_EQ(read.points[i].segment, r.points[i].segment);
  }
  ASSERT_EQ(read.keyframes.size(), r.keyframes.size());
  for (size_t k = 0; k < r.keyframes.size(); ++k) {
    EXPECT_EQ(read.keyframes[k].frame, r.keyframes[k].frame);
    EXPECT_EQ(read.keyframes[k].last_observation, r.keyframes[k].last_observation);
    EXPECT_EQ(read.frames[r.keyframes[k].frame].image_name, r.frames[r.keyframes[k].frame].image_name);
  }
  ASSERT_EQ(read.observations.size(), r.observations.size());
  for (size_t i = 0; i < r.observations.size(); ++i) {
    EXPECT_EQ(read.observations[i].point, r.observations[i].point);
    EXPECT_EQ(read.observations[i].camera, r.observations[i].camera);
    EXPECT_LT((read.observations[i].pixel - r.observations[i].pixel).norm(), 1e-12);
  }
}

TEST(ReconstructionFolder, ReadsBackWhatWasWritten) {
  for (const int cameras : {1, 2}) {
    for (const bool two_worlds : {false, true}) {
      const TemporaryFolder folder;
      const Reconstruction r = uneven_reconstruction(cameras, two_worlds);
      ASSERT_TRUE(write_output_folder(r, {}, "", folder.path()).ok());
      const Result<Reconstruction> read = read_reconstruction(folder.path());
      ASSERT_TRUE(read.ok()) << read.error().message;
      expect_same_frames(*read, r);
      expect_same_map(*read, r);
      EXPECT_EQ(read->rms_reprojection_px, r.rms_reprojection_px);
      EXPECT_EQ(read->metric_scale, r.metric_scale);
      EXPECT_EQ(read->scale_sigma, r.scale_sigma);
      ASSERT_EQ(read->segments.size(), r.segments.size());
      for (size_t s = 0; s < r.segments.size(); ++s) {
        EXPECT_EQ(read->segments[s].last, r.segments[s].last);
        EXPECT_EQ(read->segments[s].reason, r.segments[s].reason);
        EXPECT_EQ(read->segments[s].scale_sigma, r.segments[s].scale_sigma);
        EXPECT_EQ(read->starts[s].frames, r.starts[s].frames);
      }
      ASSERT_EQ(read->rig.cameras.size(), r.rig.cameras.size());
      for (int c = 0; c < cameras; ++c) {
        EXPECT_EQ(std::get<Pinhole>(read->rig.cameras[c].model).fx, 500.0 + 1.0 / 3);
        EXPECT_LT((read->rig.cameras[c].rig_from_cam.translation - r.rig.cameras[c].rig_from_cam.translation)
                      .norm(),
                  1e-12);
      }
    }
  }
}

TEST(ReconstructionFolder, DamagedFoldersAreNamed) {
  const TemporaryFolder folder;
  const auto message = [&] {
    const Result<Reconstruction> read = read_reconstruction(folder.path());
    return read.ok() ? std::string() : read.error().message;
  };
  EXPECT_NE(message().find("report.json: no such file"), std::string::npos);
  folder.file("report.json", "{}");
  EXPECT_NE(message().find("not the report of a run"), std::string::npos);
  ASSERT_TRUE(write_output_folder(uneven_reconstruction(1, false), {}, "", folder.path()).ok());
  EXPECT_EQ(message(), "");
  folder.file("points.ply", "ply\nelement vertex 3\nend_header\nshort");
  EXPECT_NE(message().find("points.ply: not a file of points"), std::string::npos);
  folder.file("covariance.csv", "1,2,3\n");
  EXPECT_NE(message().find("covariance.csv:1"), std::string::npos);
}

}  // namespace
}  // namespace raysfm
