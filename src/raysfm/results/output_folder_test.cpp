#include "raysfm/results/output_folder.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <nlohmann/json.hpp>
#include <sstream>

#include "raysfm/files/atomic_file.h"
#include "raysfm/files/staged_folder.h"
#include "raysfm/results/covariance_file.h"
#include "raysfm/results/lens_file.h"
#include "raysfm/results/ply_file.h"
#include "raysfm/results/trajectory_file.h"
#include "support/small_reconstruction.h"
#include "support/temporary_folder.h"

namespace raysfm {
namespace {

namespace fs = std::filesystem;
using testing_support::content_of;
using testing_support::small_reconstruction;
using testing_support::TemporaryFolder;

const Pinhole kPinhole{500, 510, 319.5, 239.5};

Report example_report() {
  Report report;
  report.version = "1.2.3";
  report.seed = 7;
  report.input = {"video.mp4"};
  report.camera_class = "central";
  report.error = "pixel";
  report.stages = {{"detect", {}}};
  report.stages[0].second.add(2);
  report.stages[0].second.add(4);
  report.wall_s = 1.5;
  report.frames_per_second = 8;
  report.peak_rss_mib = 99;
  return report;
}

TEST(OutputFolder, HoldsEveryFileOfTheContract) {
  const TemporaryFolder temporary;
  const fs::path folder = temporary.path() / "new" / "out";
  const Reconstruction r = small_reconstruction({kPinhole});
  const Result<bool> written = write_output_folder(r, example_report(), "seed: 7\n", folder);
  ASSERT_TRUE(written.ok()) << written.error().message;
  for (const char* name :
       {"trajectory.txt", "keyframes.txt", "covariance.csv", "points.ply", "sparse/cameras.bin",
        "sparse/images.bin", "sparse/points3D.bin", "report.json", "config.yaml"}) {
    EXPECT_TRUE(fs::exists(folder / name)) << name;
  }
  EXPECT_EQ(content_of(folder / "config.yaml"), "seed: 7\n");
  EXPECT_NE(content_of(folder / "trajectory.txt").find("# scale: arbitrary\n"), std::string::npos);

  const Result<Trajectory> all = read_trajectory(folder / "trajectory.txt");
  const Result<Trajectory> keyframes = read_trajectory(folder / "keyframes.txt");
  ASSERT_TRUE(all.ok() && keyframes.ok());
  EXPECT_EQ(all->size(), 11);  // frame 5 has no pose
  ASSERT_EQ(keyframes->size(), 4);
  EXPECT_NEAR(keyframes->timestamps[1], r.frames[3].timestamp, 1e-9);
  EXPECT_LT((keyframes->world_from_cam[1].translation - r.frames[3].world_from_rig->translation).norm(),
            1e-9);
}

TEST(OutputFolder, UnwritableFolderIsAnError) {
  const TemporaryFolder temporary;
  const fs::path file = temporary.file("occupied", "");
  const Result<bool> written =
      write_output_folder(small_reconstruction({kPinhole}), example_report(), "", file / "out");
  ASSERT_FALSE(written.ok());
  EXPECT_NE(written.error().message.find("folder cannot be created"), std::string::npos);
}

TEST(ReportFile, HoldsWhatTheContractLists) {
  Reconstruction r = small_reconstruction({kPinhole});
  const auto json = nlohmann::json::parse(report_json(r, example_report()));
  EXPECT_EQ(json["version"], "1.2.3");
  EXPECT_EQ(json["seed"], 7);
  EXPECT_EQ(json["input"], nlohmann::json({"video.mp4"}));
  EXPECT_EQ(json["camera_class"], "central");
  EXPECT_EQ(json["error"], "pixel");
  EXPECT_EQ(json["scale"], "arbitrary");
  EXPECT_EQ(json["frames"]["total"], 12);
  EXPECT_EQ(json["frames"]["posed"], 11);
  ASSERT_EQ(json["frames"]["without_pose"].size(), 1u);
  EXPECT_EQ(json["frames"]["without_pose"][0]["index"], 5);
  EXPECT_EQ(json["frames"]["without_pose"][0]["reason"], "too few matches: 3");
  EXPECT_EQ(json["keyframes"], 4);
  EXPECT_EQ(json["points"], 200);
  EXPECT_EQ(json["observations"], r.observations.size());
  EXPECT_EQ(json["rms_reprojection_px"], 0.25);
  EXPECT_EQ(json["segments"][0]["last"], 11);
  EXPECT_EQ(json["segments"][0]["reason"], "end of input");
  EXPECT_EQ(json["start"]["method"], "five-point");
  EXPECT_EQ(json["start"]["frames"], nlohmann::json({0, 3, 6}));
  EXPECT_EQ(json["start"]["inliers"], 87);
  EXPECT_EQ(json["timing"]["detect"]["mean_ms"], 3);
  EXPECT_EQ(json["timing"]["detect"]["max_ms"], 4);
  EXPECT_EQ(json["timing"]["detect"]["count"], 2);
  EXPECT_EQ(json["timing"]["wall_s"], 1.5);
  EXPECT_TRUE(json["scale_sigma_percent"].is_null());
  r.metric_scale = true;
  r.scale_sigma = 0.015;
  r.segments[0].scale_sigma = 0.25;
  const auto metric = nlohmann::json::parse(report_json(r, example_report()));
  EXPECT_EQ(metric["scale"], "metric");
  EXPECT_EQ(metric["scale_sigma_percent"], 1.5);
  EXPECT_EQ(metric["segments"][0]["scale"], "arbitrary");
  EXPECT_EQ(metric["segments"][0]["scale_sigma_percent"], 25);
}

TEST(ReportFile, SaysWhatIsOfOneCommandOnly) {
  Report report = example_report();
  report.adjustment = {
      .method = "polished", .initial_cost = 2, .final_cost = 1, .iterations = 5, .read_s = 3};
  report.lens = {.zooming = true, .evidence = "it does", .width = 640, .height = 480};
  const auto solved = nlohmann::json::parse(
      report_json(testing_support::small_solved_reconstruction(true, {-0.125, 0}), report));
  EXPECT_EQ(solved["command"], "solve");
  EXPECT_EQ(solved["lens"], "zooming");
  EXPECT_TRUE(solved["degenerate"].is_null());
  EXPECT_EQ(solved["image_size"], nlohmann::json({640, 480}));
  EXPECT_EQ(solved["distortion"]["k1"], -0.125);
  EXPECT_EQ(solved["cost"]["final"], 1);
  EXPECT_EQ(solved["timing"]["read_s"], 3);
  EXPECT_EQ(solved["lenses"].size(), 11u);
  EXPECT_FALSE(solved.contains("rig"));
  // One lens of all frames: a run over the frame without a pose.
  const auto fixed =
      nlohmann::json::parse(report_json(testing_support::small_solved_reconstruction(false, {}), report));
  EXPECT_EQ(fixed["lenses"][0]["frames"], nlohmann::json::parse("[[0, 11]]"));
  EXPECT_TRUE(fixed["distortion"].is_null());

  Reconstruction model;
  model.origin = Origin::kAdjust;
  report.lens.reset();
  report.model = {.format = "bal", .name = "a.txt", .loss = "cauchy", .used_observations = 7};
  const auto adjusted = nlohmann::json::parse(report_json(model, report));
  EXPECT_EQ(adjusted["command"], "adjust");
  EXPECT_EQ(adjusted["model"], "a.txt");
  EXPECT_EQ(adjusted["loss"]["name"], "cauchy");
  EXPECT_EQ(adjusted["used"], 7);
  EXPECT_FALSE(adjusted.contains("lenses"));
}

TEST(ReportFile, AnyBytesInANameStayJson) {
  Report report = example_report();
  report.input = {"caf\xe9 \"\n.mp4"};
  EXPECT_TRUE(nlohmann::json::accept(report_json(small_reconstruction({kPinhole}), report)));
}

TEST(ReportFile, NothingReconstructedIsStillAReport) {
  const auto json = nlohmann::json::parse(report_json(Reconstruction{}, Report{}));
  EXPECT_EQ(json["frames"]["total"], 0);
  EXPECT_TRUE(json["start"].is_null());
}

TEST(CovarianceFile, UpperTriangleByRows) {
  const TemporaryFolder folder;
  const Reconstruction r = small_reconstruction({kPinhole});
  ASSERT_TRUE(write_covariance_csv(r, folder.path() / "c.csv").ok());
  std::istringstream text(content_of(folder.path() / "c.csv"));
  std::string line;
  while (std::getline(text, line) && line[0] == '#') continue;
  EXPECT_EQ(line.substr(0, 45), "timestamp,vx_vx,vx_vy,vx_vz,vx_wx,vx_wy,vx_wz");
  EXPECT_EQ(std::count(line.begin(), line.end(), ','), 21);
  ASSERT_TRUE(std::getline(text, line));
  // Entry (i, j) of the example is 1e-6 (10 i + j).
  EXPECT_EQ(line.substr(0, 62), "100.000000000,0,1e-06,2e-06,3e-06,4e-06,5e-06,1.1e-05,1.2e-05,");
  EXPECT_EQ(line.substr(line.rfind(',')), ",5.5e-05");
  int rows = 1;
  while (std::getline(text, line)) ++rows;
  EXPECT_EQ(rows, 11);
}

TEST(LensFile, HasALineForEachFrameWithAPoseAndAColumnForEachNumber) {
  const TemporaryFolder folder;
  Reconstruction r;
  r.lenses.push_back(frame_lens({500, 501, 320, 240, 0}, {}));
  r.lenses[0].sigma << 1, 2, 3, INFINITY, 0;
  r.frames.resize(3);
  r.frames[1].timestamp = 0.5;
  r.frames[1].world_from_rig = Rigid3{};
  r.frames[1].lens = 0;
  r.frames[2].world_from_rig = Rigid3{};  // of another camera
  ASSERT_TRUE(write_lens_file(r, folder.path() / "lens.csv").ok());
  EXPECT_EQ(content_of(folder.path() / "lens.csv"),
            "timestamp,fx,fy,cx,cy,skew,fx_sigma,fy_sigma,cx_sigma,cy_sigma,skew_sigma\n"
            "0.500000000,500.000000,501.000000,320.000000,240.000000,0.000000,1,2,3,inf,0\n");
}

TEST(OutputFolder, WhoMadeItDecidesWhatIsInIt) {
  const TemporaryFolder folder;
  Reconstruction r = testing_support::small_solved_reconstruction(true, {});
  const ResultFile more{"more.txt", [](const fs::path& path) { return write_file(path, "more"); }};
  ASSERT_TRUE(write_output_folder(r, example_report(), "", folder.path(), std::span(&more, 1)).ok());
  using Names = std::vector<std::string>;
  EXPECT_EQ(files_below(folder.path()),
            (Names{"config.yaml", "covariance.csv", "keyframes.txt", "lens.csv", "more.txt", "points.ply",
                   "report.json", "sparse/cameras.bin", "sparse/images.bin", "sparse/points3D.bin",
                   "trajectory.txt"}));
  EXPECT_NE(content_of(folder.path() / "trajectory.txt").find("world from camera"), std::string::npos);
  r.origin = Origin::kAdjust;
  ASSERT_TRUE(write_output_folder(r, example_report(), "", folder.path()).ok());
  EXPECT_EQ(files_below(folder.path()), (Names{"config.yaml", "points.ply", "report.json"}));
  r = small_reconstruction({kPinhole});
  ASSERT_TRUE(write_output_folder(r, example_report(), "", folder.path()).ok());
  EXPECT_EQ(files_below(folder.path()),
            (Names{"config.yaml", "covariance.csv", "keyframes.txt", "points.ply", "report.json",
                   "sparse/cameras.bin", "sparse/images.bin", "sparse/points3D.bin", "trajectory.txt"}));
}

TEST(OutputFolder, InputsAreNotReplaced) {
  const TemporaryFolder folder;
  const std::vector<std::string> inputs = {folder.file("more.txt", "mine").string()};
  EXPECT_TRUE(check_output_folder(folder.path(), inputs).ok());
  EXPECT_FALSE(check_output_folder(folder.path(), inputs, std::vector<std::string>{"more.txt"}).ok());
}

TEST(PlyFile, IsBinaryWithPositionAndColour) {
  const TemporaryFolder folder;
  const Reconstruction r = small_reconstruction({kPinhole});
  ASSERT_TRUE(write_points_ply(r, folder.path() / "p.ply").ok());
  const std::string bytes = content_of(folder.path() / "p.ply");
  EXPECT_EQ(bytes.rfind("ply\nformat binary_little_endian 1.0\n", 0), 0u);
  EXPECT_NE(bytes.find("element vertex 200\nproperty float x\nproperty float y\nproperty float z\n"
                       "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n"),
            std::string::npos);
  const size_t data = bytes.find("end_header\n") + 11;
  ASSERT_EQ(bytes.size() - data, 200u * 15);
  float position[3];
  std::memcpy(position, bytes.data() + data + 15 * 17, sizeof(position));
  EXPECT_EQ(position[2], static_cast<float>(r.points[17].position.z()));
  EXPECT_EQ(static_cast<uint8_t>(bytes[data + 15 * 17 + 14]), r.points[17].rgb[2]);
}

}  // namespace
}  // namespace raysfm
