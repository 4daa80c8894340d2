#include "raysfm/results/reconstruction_folder.h"

#include <gtest/gtest.h>

#include <fstream>

#include <cmath>
#include <string>
#include <tuple>

#include "raysfm/camera_files/camera_file.h"
#include "raysfm/colmap_bal/colmap_file.h"
#include "raysfm/colmap_bal/model_reconstruction.h"
#include "raysfm/files/staged_folder.h"
#include "raysfm/results/output_folder.h"
#include "support/small_reconstruction.h"
#include "support/temporary_folder.h"

namespace raysfm {
namespace {

namespace fs = std::filesystem;
using testing_support::content_of;
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
    frame.place_held = i == 4 || i == 5 || i == 8;
  }
  r.rms_reprojection_px = 1.0 / 7;
  r.metric_scale = r.segments[0].metric_scale = true;
  r.scale_sigma = r.segments[0].scale_sigma = 1.0 / 7;
  if (!two_worlds) return r;
  r.segments = {{0, 2, "track lost", false, 0.1}, {3, 11, "end of input", true, 1.0 / 7}};
  r.calibration = {{0, "k1", 0, 1.0 / 3, 1.0 / 7, 5.5, true}, {0, "cx", 320.1, 320.1, 6.4, 0, false}};
  r.starts = {{"five-point", {0, 1, 2}, 20}, {"pless", {3, 6, 9}, 30}};
  r.closures = {{8, 1, 77, false, 1.0 / 3}, {11, 0, 45, true, 0}};
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
    EXPECT_EQ(a.place_held, b.place_held);
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

void expect_same_report(const Reconstruction& read, const Reconstruction& r) {
  EXPECT_EQ(read.origin, r.origin);
  EXPECT_EQ(read.rms_reprojection_px, r.rms_reprojection_px);
  EXPECT_EQ(read.metric_scale, r.metric_scale);
  EXPECT_EQ(read.scale_sigma, r.scale_sigma);
  ASSERT_EQ(read.segments.size(), r.segments.size());
  for (size_t s = 0; s < r.segments.size(); ++s) {
    EXPECT_EQ(read.segments[s].first, r.segments[s].first);
    EXPECT_EQ(read.segments[s].last, r.segments[s].last);
    EXPECT_EQ(read.segments[s].reason, r.segments[s].reason);
    EXPECT_EQ(read.segments[s].metric_scale, r.segments[s].metric_scale);
    EXPECT_EQ(read.segments[s].scale_sigma, r.segments[s].scale_sigma);
  }
  ASSERT_EQ(read.calibration.size(), r.calibration.size());
  for (size_t i = 0; i < r.calibration.size(); ++i) {
    const CalibrationNumber &a = read.calibration[i], &b = r.calibration[i];
    EXPECT_EQ(std::tie(a.camera, a.name, a.given, a.refined, a.sigma, a.significance, a.told),
              std::tie(b.camera, b.name, b.given, b.refined, b.sigma, b.significance, b.told));
  }
  ASSERT_EQ(read.closures.size(), r.closures.size());
  for (size_t i = 0; i < r.closures.size(); ++i) {
    const Closure &a = read.closures[i], &b = r.closures[i];
    EXPECT_EQ(std::tie(a.frame, a.with_frame, a.inliers, a.joined_worlds, a.correction),
              std::tie(b.frame, b.with_frame, b.inliers, b.joined_worlds, b.correction));
  }
  ASSERT_EQ(read.starts.size(), r.starts.size());
  for (size_t s = 0; s < r.starts.size(); ++s) {
    EXPECT_EQ(read.starts[s].method, r.starts[s].method);
    EXPECT_EQ(read.starts[s].frames, r.starts[s].frames);
    EXPECT_EQ(read.starts[s].inliers, r.starts[s].inliers);
  }
}

void expect_same_lenses(const Reconstruction& read, const Reconstruction& r) {
  ASSERT_EQ(read.lenses.size(), r.lenses.size());
  for (size_t i = 0; i < r.lenses.size(); ++i) {
    const FrameLens &a = read.lenses[i], &b = r.lenses[i];
    EXPECT_EQ(model_name(a.camera.model), model_name(b.camera.model));
    ASSERT_TRUE(lens_of(a) && lens_of(b));
    EXPECT_EQ(lens_of(a)->vector(), lens_of(b)->vector());
    EXPECT_EQ(radial_distortion_of(a.camera).k1, radial_distortion_of(b.camera).k1);
    EXPECT_EQ(radial_distortion_of(a.camera).k2, radial_distortion_of(b.camera).k2);
    EXPECT_EQ(a.sigma, b.sigma);
    EXPECT_EQ(a.radial_sigma.k1, b.radial_sigma.k1);
    EXPECT_EQ(a.radial_sigma.k2, b.radial_sigma.k2);
    EXPECT_EQ(a.camera.width, b.camera.width);
    EXPECT_EQ(a.camera.height, b.camera.height);
  }
  for (size_t i = 0; i < r.frames.size(); ++i) EXPECT_EQ(read.frames[i].lens, r.frames[i].lens) << i;
}

// What is read, written anew and read again; the files are the same each time. Only the errors of points in
// sparse/, which nothing reads, may change by a rounding at first.
Reconstruction written_and_read(const Reconstruction& r) {
  const TemporaryFolder folder;
  const fs::path first = folder.path() / "0";
  EXPECT_TRUE(write_output_folder(r, {}, "", first).ok());
  Result<Reconstruction> read = read_reconstruction(first);
  for (const char* name : {"1", "2"}) {
    if (!read) break;
    const fs::path folder_before = folder.path() / (name[0] == '1' ? "0" : "1");
    EXPECT_TRUE(write_output_folder(*read, {}, "", folder.path() / name).ok());
    for (const std::string& file : files_below(folder_before)) {
      if (name[0] == '1' && fs::path(file).filename() == "points3D.bin") continue;
      EXPECT_EQ(content_of(folder.path() / name / file), content_of(folder_before / file)) << file;
    }
    read = read_reconstruction(folder.path() / name);
  }
  EXPECT_TRUE(read.ok()) << read.error().message;
  return read ? *std::move(read) : Reconstruction{};
}

void expect_same(const Reconstruction& read, const Reconstruction& r) {
  expect_same_frames(read, r);
  expect_same_map(read, r);
  expect_same_report(read, r);
  expect_same_lenses(read, r);
}

TEST(ReconstructionFolder, ReadsBackWhatTrackWrote) {
  for (const int cameras : {1, 2}) {
    for (const bool two_worlds : {false, true}) {
      const Reconstruction r = uneven_reconstruction(cameras, two_worlds);
      const Reconstruction read = written_and_read(r);
      expect_same(read, r);
      ASSERT_EQ(read.rig.cameras.size(), r.rig.cameras.size());
      for (int c = 0; c < cameras; ++c) {
        const Camera &a = read.rig.cameras[c], &b = r.rig.cameras[c];
        EXPECT_EQ(a.name, b.name);
        EXPECT_EQ(std::get<Pinhole>(a.model).fx, 500.0 + 1.0 / 3);
        EXPECT_EQ(a.rig_from_cam.translation, b.rig_from_cam.translation);
        EXPECT_EQ(a.rig_from_cam.rotation.coeffs(), b.rig_from_cam.rotation.coeffs());
      }
    }
  }
}

// The models are those of the camera file, if it is theirs; who sees what is known anyway.
TEST(ReconstructionFolder, ReadsBackWhoSeesWhatOfCamerasThatColmapLacks) {
  for (const bool two_worlds : {false, true}) {
    Reconstruction r = uneven_reconstruction(2, two_worlds);
    for (Camera& camera : r.rig.cameras) camera.model = Equirectangular{100, 100, 319.5, 239.5};
    const TemporaryFolder folder;
    ASSERT_TRUE(write_output_folder(r, {}, "", folder.path()).ok());
    const Result<Reconstruction> result = read_reconstruction(folder.path());
    ASSERT_TRUE(result.ok()) << result.error().message;
    const Reconstruction& read = *result;
    EXPECT_TRUE(read.rig.cameras.empty());
    Rig other = r.rig, larger = r.rig, one = r.rig;
    other.cameras[1].model = Pinhole{100, 100, 319.5, 239.5};
    larger.cameras[0].width = 641;
    one.cameras.resize(1);
    for (const Rig& rig : {other, larger, one}) {
      ASSERT_TRUE(write_camera_file(rig, folder.path() / "camera.yaml").ok());
      const Result<Reconstruction> without = read_reconstruction(folder.path());
      EXPECT_TRUE(without.ok() && without->rig.cameras.empty());
    }
    folder.file("camera.yaml", "no camera file");
    EXPECT_TRUE(read_reconstruction(folder.path()).ok());
    other = r.rig;
    other.cameras[0].name = "as the report has it";
    other.cameras[0].rig_from_cam.translation.x() += 1;
    ASSERT_TRUE(write_camera_file(other, folder.path() / "camera.yaml").ok());
    const Result<Reconstruction> with = read_reconstruction(folder.path());
    ASSERT_TRUE(with.ok() && with->rig.cameras.size() == 2);
    EXPECT_EQ(std::get<Equirectangular>(with->rig.cameras[1].model).cx, 319.5);
    EXPECT_EQ(with->rig.cameras[0].name, r.rig.cameras[0].name);
    EXPECT_EQ(with->rig.cameras[0].rig_from_cam.translation, r.rig.cameras[0].rig_from_cam.translation);
    ASSERT_EQ(read.keyframes.size(), r.keyframes.size());
    for (size_t k = 0; k < r.keyframes.size(); ++k) {
      EXPECT_EQ(read.keyframes[k].first_observation, r.keyframes[k].first_observation);
      EXPECT_EQ(read.keyframes[k].last_observation, r.keyframes[k].last_observation);
    }
    ASSERT_EQ(read.observations.size(), r.observations.size());
    for (size_t i = 0; i < r.observations.size(); ++i) {
      EXPECT_EQ(read.observations[i].point, r.observations[i].point);
      EXPECT_EQ(read.observations[i].camera, r.observations[i].camera);
      EXPECT_EQ(read.observations[i].pixel, r.observations[i].pixel);
    }
  }
}

TEST(ReconstructionFolder, DamagedObservationsAreNamed) {
  Reconstruction r = uneven_reconstruction(1, false);
  for (Camera& camera : r.rig.cameras) camera.model = Equirectangular{100, 100, 319.5, 239.5};
  const TemporaryFolder folder;
  ASSERT_TRUE(write_output_folder(r, {}, "", folder.path()).ok());
  const std::string header = "keyframe,camera,point,u,v\n";
  for (const std::string line :
       {"0,0,0,1", "0,0,0,1,nan", "0,0,99999999,1,2", "-1,0,0,1,2", "9999,0,0,1,2", "1,0,0,1,2\n0,0,0,1,2"}) {
    std::ofstream(folder.path() / "observations.csv") << header << line << "\n";
    const Result<Reconstruction> read = read_reconstruction(folder.path());
    ASSERT_FALSE(read.ok()) << line;
    EXPECT_NE(read.error().message.find("observations.csv:"), std::string::npos) << read.error().message;
  }
}

TEST(ReconstructionFolder, ReadsBackWhatSolveWrote) {
  for (const bool zooming : {false, true}) {
    for (const RadialDistortion& radial : {RadialDistortion{}, RadialDistortion{-1.0 / 7, 1.0 / 30}}) {
      Reconstruction r = testing_support::small_solved_reconstruction(zooming, radial);
      r.rms_reprojection_px = 1.0 / 7;
      r.metric_scale = r.segments[0].metric_scale = zooming;
      for (Observation& o : r.observations) o.pixel *= 1 + 1.0 / 4096;
      const Reconstruction read = written_and_read(r);
      expect_same(read, r);
      EXPECT_TRUE(read.rig.cameras.empty());
    }
  }
}

// Writes what `adjust` would and reads it.
Result<Reconstruction> adjusted_and_read(const Reconstruction& r, const char* format,
                                         const ResultFile& model) {
  const TemporaryFolder folder;
  Report report;
  report.model = {.format = format, .name = model.name};
  const Result<bool> written = write_output_folder(r, report, "", folder.path(), std::span(&model, 1));
  if (!written) return written.error();
  EXPECT_EQ(files_below(folder.path()).size(), format == std::string("bal") ? 4u : 6u);
  return read_reconstruction(folder.path());
}

void expect_same_observations(const Reconstruction& read, const Reconstruction& r) {
  ASSERT_EQ(read.observations.size(), r.observations.size());
  for (size_t i = 0; i < r.observations.size(); ++i)
    EXPECT_EQ(read.observations[i].pixel, r.observations[i].pixel);
}

TEST(ReconstructionFolder, ReadsBackWhatAdjustWroteAsBal) {
  const double third = 1.0 / 3;
  const BalFile file{.cameras = {{third, 0.2, 0.3, 1e-3, -third, 0, 400 + third, -0.05, 0.01},
                                 {0.3, third, 0.1, -2, 0.1, third, 410, third, -0.03}},
                     .points = {{third, 0.1, -5}, {-1, third, -6}},
                     .observations = {{1, 0, {third, -7}}, {0, 0, {0.1, 100 + third}}, {1, 1, {3, 4}}},
                     .compressed = true};
  Reconstruction r = reconstruction_of(file);
  r.rms_reprojection_px = third;
  const Result<Reconstruction> read = adjusted_and_read(
      r, "bal", {"a.txt.bz2", [&](const fs::path& path) { return write_bal_file(file, path); }});
  ASSERT_TRUE(read.ok()) << read.error().message;
  expect_same(*read, r);
  expect_same_observations(*read, r);
}

TEST(ReconstructionFolder, ReadsBackWhatAdjustWroteAsColmapModel) {
  const TemporaryFolder folder;
  ASSERT_TRUE(write_colmap_model(uneven_reconstruction(1, false), folder.path() / "model").ok());
  Result<ColmapModel> model = read_colmap_model(folder.path() / "model");
  ASSERT_TRUE(model.ok());
  for (const bool binary : {false, true}) {
    model->binary = binary;
    const Reconstruction r = reconstruction_of(*model);
    const Result<Reconstruction> read = adjusted_and_read(
        r, "colmap", {"sparse", [&](const fs::path& path) { return write_colmap_model(*model, path); }});
    ASSERT_TRUE(read.ok()) << read.error().message;
    expect_same(*read, r);
    expect_same_observations(*read, r);
  }
}

TEST(ReconstructionFolder, DamagedFoldersAreNamed) {
  const TemporaryFolder folder;
  const auto message = [&] {
    const Result<Reconstruction> read = read_reconstruction(folder.path());
    return read.ok() ? std::string() : read.error().message;
  };
  EXPECT_NE(message().find("report.json: no such file; a result"), std::string::npos);
  const Result<Reconstruction> of_a_file = read_reconstruction(folder.file("map.ply", "ply\n"));
  ASSERT_FALSE(of_a_file.ok());
  EXPECT_NE(of_a_file.error().message.find("map.ply: not a folder"), std::string::npos);
  for (const auto& [report, says] :
       {std::pair("{\n \"command\": \"track\",\n \"seg", "line 3: no valid JSON"),
        {"{}", "'command' is missing"},
        {"{\"command\": 3}", "a value is of another kind"},
        {"[]", "a value is of another kind"}}) {
    folder.file("report.json", report);
    EXPECT_EQ(message().find((folder.path() / "report.json").string() + ": not the report of a run: " + says),
              0u)
        << message();
    EXPECT_EQ(message().find("exception"), std::string::npos) << message();
  }
  ASSERT_TRUE(write_output_folder(uneven_reconstruction(1, false), {}, "", folder.path()).ok());
  EXPECT_EQ(message(), "");
  folder.file("points.ply", "ply\nelement vertex 3\nend_header\nshort");
  EXPECT_NE(message().find("points.ply: not a file of points"), std::string::npos);
  folder.file("covariance.csv", "1,2,3\n");
  EXPECT_NE(message().find("covariance.csv:1"), std::string::npos);
}

}  // namespace
}  // namespace raysfm
