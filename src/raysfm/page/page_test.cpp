#include "raysfm/page/page.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <vector>

#include "raysfm/camera/fit_ray_table.h"
#include "raysfm/page/page_data.h"
#include "raysfm/page/page_mesh.h"
#include "support/small_reconstruction.h"
#include "support/temporary_folder.h"

namespace raysfm {
namespace {

using nlohmann::json;
using testing_support::content_of;
using testing_support::small_reconstruction;
using testing_support::small_solved_reconstruction;
using testing_support::TemporaryFolder;

const Pinhole kPinhole{500, 510, 319.5, 239.5};

// RFC 4648, back to numbers.
template <typename T>
std::vector<T> unpacked(const std::string& text) {
  std::string bytes;
  uint32_t group = 0;
  int digits = 0;
  for (const char c : text) {
    if (c == '=') break;
    const size_t digit =
        std::string("ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/").find(c);
    group = group << 6 | static_cast<uint32_t>(digit);
    digits += 6;
    if (digits >= 8) bytes += static_cast<char>(group >> (digits -= 8) & 255);
  }
  std::vector<T> numbers(bytes.size() / sizeof(T));
  std::memcpy(numbers.data(), bytes.data(), numbers.size() * sizeof(T));
  return numbers;
}

// What comes first.
json first_of(const Reconstruction& r, const PageInfo& info) {
  return json::parse(page_data(r, info).first);
}

TEST(Page, FramesAreThoseOfTheResult) {
  Reconstruction r = small_reconstruction({kPinhole, kPinhole});
  for (const int held : {2, 3, 8}) r.frames[held].place_held = true;
  const json data = first_of(r, {.title = "title"});
  EXPECT_EQ(data["held"], json::parse(R"([{"first": 2, "last": 3}, {"first": 8, "last": 8}])"));
  EXPECT_EQ(data["total"], 12);
  EXPECT_EQ(data["posed"], 11);
  EXPECT_EQ(data["missing"], json::parse(R"([{"first": 5, "last": 5, "reason": "too few matches: 3"}])"));
  ASSERT_EQ(data["cameras"].size(), 2u);
  ASSERT_EQ(data["worlds"].size(), 1u);
  const json& frames = data["worlds"][0]["frames"];
  const auto index = unpacked<uint32_t>(frames["index"]);
  const auto time = unpacked<double>(frames["time"]);
  const auto pose = unpacked<float>(frames["pose"]), covariance = unpacked<float>(frames["covariance"]);
  ASSERT_EQ(index.size(), 11u);
  ASSERT_EQ(pose.size(), 77u);
  for (size_t i = 0; i < index.size(); ++i) {
    const PosedFrame& frame = r.frames[index[i]];
    EXPECT_EQ(time[i], frame.timestamp);
    EXPECT_EQ(pose[7 * i], static_cast<float>(frame.world_from_rig->translation.x()));
    EXPECT_EQ(pose[7 * i + 6], static_cast<float>(frame.world_from_rig->rotation.w()));
    // small_reconstruction: 10 * smaller + larger, in millionths.
    EXPECT_EQ(covariance[6 * i + 2], 2e-6f);
    EXPECT_EQ(covariance[6 * i + 4], 12e-6f);
  }
  EXPECT_EQ(index[5], 6u);
  const auto keyframes = unpacked<uint32_t>(data["worlds"][0]["keyframes"]["frame"]);
  EXPECT_EQ(keyframes, (std::vector<uint32_t>{0, 3, 5, 8}));  // frames 0, 3, 6 and 9, of which 5 is not there
  // Observations are exact.
  for (const float error : unpacked<float>(data["worlds"][0]["keyframes"]["error"])) EXPECT_LT(error, 1e-6);
}

TEST(Page, CamerasThatCannotProjectHaveErrorsToo) {
  Reconstruction r = small_reconstruction({kPinhole, kPinhole});
  const Result<RayFit> fit = fit_ray_table(r.rig.cameras[1]);
  ASSERT_TRUE(fit.ok());
  for (Camera& camera : r.rig.cameras) camera.model = fit->camera.model;
  for (Observation& o : r.observations) o.pixel += Eigen::Vector2d(0.3, -0.4);
  const json data = first_of(r, {.title = "title"});
  const auto errors = unpacked<float>(data["worlds"][0]["keyframes"]["error"]);
  ASSERT_EQ(errors.size(), 4u);
  for (const float error : errors) EXPECT_NEAR(error, 0.5, 0.01);
}

// A point of a page, within a step of its place.
struct Shown {
  Eigen::Vector3d position, step;
  std::array<uint8_t, 3> rgb;
};

// Those of world `w` in the order of the page, and how many of them come first.
struct ShownPoints {
  json numbers;
  std::vector<Shown> all;
  size_t first = 0;
};

ShownPoints points_of(const PageData& data, size_t w = 0) {
  ShownPoints points;
  points.numbers = json::parse(data.first)["worlds"][w]["points"];
  const auto of = [&](const char* name, int i) { return points.numbers[name][i].get<double>(); };
  for (const json& part : {points.numbers, json::parse(data.rest)[w]}) {
    const auto xyz = unpacked<uint16_t>(part["xyz"]);
    const auto rgb = unpacked<uint8_t>(part["rgb"]);
    EXPECT_EQ(xyz.size(), rgb.size());
    for (size_t i = 0; i + 2 < xyz.size(); i += 3) {
      Shown& shown = points.all.emplace_back();
      for (int axis = 0; axis < 3; ++axis) {
        shown.step[axis] = (of("high", axis) - of("low", axis)) / 65535;
        shown.position[axis] = of("low", axis) + xyz[i + axis] * shown.step[axis];
        shown.rgb[axis] = rgb[i + axis];
      }
    }
    if (points.first == 0) points.first = points.all.size();
  }
  return points;
}

// Colours tell them apart.
std::array<uint8_t, 3> coloured(size_t number) {
  return {static_cast<uint8_t>(number), static_cast<uint8_t>(number >> 8),
          static_cast<uint8_t>(number >> 16)};
}
size_t number_of(const Shown& shown) {
  return shown.rgb[0] | shown.rgb[1] << 8 | shown.rgb[2] << 16;
}

// So many points, the same ones again and again, with colours that tell them apart, and no observations.
Reconstruction with_points(size_t count) {
  Reconstruction r = small_reconstruction({kPinhole});
  r.observations.clear();
  for (KeyFrame& keyframe : r.keyframes) keyframe.first_observation = keyframe.last_observation = 0;
  const std::vector<MapPoint> few = r.points;
  r.points.resize(count);
  for (size_t i = 0; i < count; ++i) {
    r.points[i] = few[i % few.size()];
    r.points[i].rgb = coloured(i);
  }
  return r;
}

TEST(Page, PointsAreWithinAStepOfTheirPlace) {
  Reconstruction r = with_points(200);
  r.points.push_back({{1e6, 0, 0}, {1, 2, 3}});
  const ShownPoints points = points_of(page_data(r, {.title = "title"}));
  EXPECT_EQ(points.numbers["count"], 200);
  EXPECT_EQ(points.numbers["far"], 1);
  EXPECT_EQ(points.first, 200u);
  ASSERT_EQ(points.all.size(), 200u);
  std::set<size_t> numbers;
  for (const Shown& shown : points.all) {
    const size_t number = number_of(shown);
    ASSERT_TRUE(numbers.insert(number).second);
    ASSERT_LT(number, 200u);
    for (int axis = 0; axis < 3; ++axis)
      EXPECT_NEAR(shown.position[axis], r.points[number].position[axis], shown.step[axis]);
  }
}

// A beginning of numbers has no gap of more than twice that of as many at the same distance.
void expect_evenly_spread(std::vector<size_t> beginning, size_t all) {
  const size_t most = 2 * all / beginning.size() + 2;
  beginning.push_back(all);
  std::ranges::sort(beginning);
  size_t before = 0;
  for (const size_t number : beginning) {
    EXPECT_LE(number - before, most) << "at " << number << " of " << beginning.size() - 1;
    before = number;
  }
}

TEST(Page, AFewPointsComeFirstAndTheRestAfterThem) {
  for (const size_t count : {1u, 2u, 3u, 7u, 1000u, 30000u, 30001u, 100000u}) {
    const ShownPoints points = points_of(page_data(with_points(count), {.title = "title"}));
    EXPECT_EQ(points.first, std::min<size_t>(count, 30000));
    ASSERT_EQ(points.all.size(), count);
    std::vector<size_t> numbers(count);
    std::ranges::transform(points.all, numbers.begin(), number_of);
    for (size_t part = 1; part <= count; part *= 3)
      expect_evenly_spread({numbers.begin(), numbers.begin() + static_cast<std::ptrdiff_t>(part)}, count);
    std::ranges::sort(numbers);
    for (size_t i = 0; i < count; ++i) ASSERT_EQ(numbers[i], i) << count;
  }
}

TEST(Page, ManyPointsAreThinned) {
  const PageData data = page_data(with_points(750000), {.title = "title"});
  EXPECT_LT(data.first.size() + data.rest.size(), 4u << 20);
  const ShownPoints shown = points_of(data);
  EXPECT_EQ(shown.numbers["count"], 300000);
  EXPECT_EQ(shown.numbers["all"], 750000);
  ASSERT_EQ(shown.all.size(), 300000u);
  std::vector<size_t> numbers(shown.all.size());
  std::ranges::transform(shown.all, numbers.begin(), number_of);
  expect_evenly_spread(numbers, 750000);
}

TEST(Page, WorldsShareWhatComesFirst) {
  Reconstruction r = with_points(80000);
  r.segments.push_back(r.segments.front());
  for (size_t p = 60000; p < r.points.size(); ++p) r.points[p].segment = 1;
  for (size_t f = 9; f < r.frames.size(); ++f) r.frames[f].segment = 1;
  const PageData data = page_data(r, {.title = "title"});
  const ShownPoints first = points_of(data, 0), second = points_of(data, 1);
  EXPECT_EQ(first.all.size() + second.all.size(), 80000u);
  EXPECT_EQ(first.first, 22500u);
  EXPECT_EQ(second.first, 7500u);
}

TEST(Page, LensesAndCameras) {
  const json solved = first_of(small_solved_reconstruction(true, {}), {.title = "title"});
  ASSERT_EQ(solved["lenses"].size(), 11u);
  EXPECT_DOUBLE_EQ(solved["lenses"][3]["focal"][0], 501);
  EXPECT_EQ(unpacked<int32_t>(solved["worlds"][0]["frames"]["lens"])[3], 3);
  // The border of a pinhole, at distance one: corners at (x - cx) / fx.
  const json tracked = first_of(small_reconstruction({kPinhole}), {.title = "title"});
  EXPECT_NEAR(tracked["cameras"][0]["directions"][0][0].get<double>(), -319.5 / 500, 1e-6);
  EXPECT_NEAR(tracked["cameras"][0]["directions"][0][1].get<double>(), -239.5 / 510, 1e-6);
}

// Pixel (x, y) of a pinhole looks along ((x - cx) / fx, (y - cy) / fy, 1), turned and shifted into the rig.
TEST(Page, RaysAreThoseOfTheCamera) {
  const Reconstruction r = small_reconstruction({kPinhole, kPinhole});
  const json data = first_of(r, {});
  const json& camera = data["cameras"][1];
  const int columns = camera["grid"][0], rows = camera["grid"][1];
  const auto rays = unpacked<float>(camera["rays"]);
  ASSERT_EQ(rays.size(), 6u * columns * rows);
  const int k = 2 * columns + 3;
  const double x = 639.0 * 3 / (columns - 1), y = 479.0 * 2 / (rows - 1);
  const Rigid3& rig_from_cam = r.rig.cameras[1].rig_from_cam;
  const Eigen::Vector3d expected =
      rig_from_cam.rotation * Eigen::Vector3d((x - 319.5) / 500, (y - 239.5) / 510, 1).normalized();
  for (int axis = 0; axis < 3; ++axis) {
    EXPECT_NEAR(rays[6 * k + axis], rig_from_cam.translation[axis], 1e-6);
    EXPECT_NEAR(rays[6 * k + 3 + axis], expected[axis], 1e-6);
  }
}

TEST(Page, ClosuresSigmasAndTimes) {
  Reconstruction r = small_reconstruction({kPinhole});
  r.closures = {{9, 1, 33, false, 0.1}, {11, -1, 20, true, 0}};
  const json data = first_of(r, {.title = "", .stages = {{"detect", 2.5, 7, 12}}});
  EXPECT_EQ(data["closures"], json::parse(R"([{"frame": 9, "with": 1, "inliers": 33, "joined": false},
                                              {"frame": 11, "with": -1, "inliers": 20, "joined": true}])"));
  EXPECT_EQ(data["stages"], json::parse(R"([{"name": "detect", "mean": 2.5, "max": 7.0, "count": 12}])"));
  EXPECT_EQ(data["live"], false);
  Reconstruction solved = small_solved_reconstruction(true, {});
  solved.lenses[3].sigma[0] = 1.5;
  solved.lenses[4].sigma[0] = std::numeric_limits<double>::infinity();
  const json lenses = first_of(solved, {})["lenses"];
  EXPECT_EQ(lenses[3]["sigma"], 1.5);
  EXPECT_FALSE(lenses[4].contains("sigma"));
}

TEST(Page, WhatTheReportSaysComesBack) {
  const TemporaryFolder temporary;
  Report report;
  report.input = {"somewhere/street.mp4"};
  report.warnings = {"the lens is another one", "<b>"};
  StageTiming detect;
  detect.add(1);
  detect.add(4);
  report.stages = {{"detect", detect}, {"pose", {}}};
  ASSERT_TRUE(write_report(small_reconstruction({kPinhole}), report, temporary.path() / "report.json").ok());
  const std::string folder = temporary.path().filename().string();
  EXPECT_EQ(page_info(report).title, "street.mp4");
  EXPECT_EQ(read_page_info(temporary.path()).title, "street.mp4 · " + folder);
  for (const PageInfo& info : {page_info(report), read_page_info(temporary.path())}) {
    EXPECT_EQ(info.warnings, report.warnings);
    const json data = first_of(small_reconstruction({kPinhole}), info);
    EXPECT_EQ(data["warnings"], json(report.warnings));
    const std::vector<StageTime>& times = info.stages;
    ASSERT_EQ(times.size(), 2u);
    EXPECT_EQ(times[0].name, "detect");
    EXPECT_EQ(times[0].mean_ms, 2.5);
    EXPECT_EQ(times[0].max_ms, 4);
    EXPECT_EQ(times[0].count, 2);
  }
  // Of what is no report, or an old one, what there is.
  EXPECT_TRUE(read_page_info(temporary.path() / "no").stages.empty());
  for (const char* text : {"{", "[]", R"({"timing": 3, "warnings": {"a": 1}, "input": "x"})"}) {
    temporary.file("report.json", text);
    const PageInfo info = read_page_info(temporary.path());
    EXPECT_TRUE(info.stages.empty() && info.warnings.empty()) << text;
  }
  // A sequence that was tracked into its own folder is named once.
  temporary.file("report.json", json{{"input", {temporary.path().string()}}}.dump());
  EXPECT_EQ(read_page_info(temporary.path()).title, folder);
}

TEST(Page, OnlyAServedPageMayAsk) {
  if (!has_page()) GTEST_SKIP() << "this build has no page";
  const Reconstruction r = small_reconstruction({kPinhole});
  EXPECT_EQ(page_html(r, {}, false)->find("connect-src"), std::string::npos);
  EXPECT_NE(page_html(r, {}, true)->find("default-src 'none'; connect-src 'self'; script-src"),
            std::string::npos);
}

TEST(Page, NoNameEndsTheScript) {
  const std::string title = "</script><script>alert('\"&')</script><!-- \xc3\xa4 \xff";
  Reconstruction r = small_reconstruction({kPinhole});
  r.rig.cameras[0].name = r.frames[5].reason = title;
  const PageData data = page_data(r, {.title = title});
  EXPECT_EQ(data.first.find('<'), std::string::npos);
  EXPECT_EQ(first_of(r, {.title = "</script>"})["title"], "</script>");
  if (!has_page()) GTEST_SKIP() << "this build has no page";
  const std::string html = *page_html(r, {.title = title}, false);
  EXPECT_EQ(html.find("<script>alert"), std::string::npos);
  EXPECT_NE(html.find("<title>&lt;/script&gt;&lt;script&gt;alert(&#39;&quot;&amp;&#39;)"), std::string::npos);
  const size_t script = html.find("<script>"), first = html.find(data.first);
  EXPECT_LT(first, script);
  EXPECT_NE(html.find(data.rest, script), std::string::npos);
  EXPECT_LT(html.size(), 2u << 20);
}

TEST(Page, AFileIsNamedAfterWhatItWasMadeOf) {
  if (!has_page()) GTEST_SKIP() << "this build has no page";
  const TemporaryFolder temporary;
  const Reconstruction r = small_reconstruction({kPinhole});
  Report report;
  report.input = {"somewhere/a <b>.mp4", (temporary.path() / "folder/").string()};
  ASSERT_TRUE(write_page(r, report, temporary.path() / "page.html").ok());
  EXPECT_NE(content_of(temporary.path() / "page.html").find("<title>a &lt;b&gt;.mp4, folder"),
            std::string::npos);
}

TEST(Page, NothingHasAPose) {
  Reconstruction r;
  r.frames.resize(3);
  for (PosedFrame& frame : r.frames) frame.reason = "black";
  const json data = first_of(r, {.title = "title"});
  EXPECT_TRUE(data["worlds"].empty());
  EXPECT_EQ(data["missing"].size(), 1u);
}

void write_text(const std::filesystem::path& path, const std::string& text) {
  std::ofstream(path, std::ios::binary) << text;
}

// Two faces of a square, as an export writes them.
void write_square(const std::filesystem::path& folder) {
  std::filesystem::create_directories(folder);
  write_text(folder / "export.json", R"({"format": "mesh", "world": 1})");
  write_text(folder / "mesh.jpg", "a picture");
  write_text(folder / "mesh.obj",
             "# a comment\nmtllib mesh.mtl\nv 0 0 2.5\nv 1 0 2.5\nv 1 1 2.5\nv 0 1 2.5\n"
             "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 0.5\nusemtl texture\nf 1/1 2/2 3/3\nf 1/1 3/3 4/4\n");
}

TEST(PageMesh, IsReadAndPutIntoThePage) {
  const TemporaryFolder temporary;
  write_square(temporary.path());
  const Result<PageMesh> mesh = read_page_mesh(temporary.path());
  ASSERT_TRUE(mesh.ok()) << mesh.error().message;
  EXPECT_EQ(mesh->world, 1);
  EXPECT_EQ(mesh->positions, (std::vector<float>{0, 0, 2.5f, 1, 0, 2.5f, 1, 1, 2.5f, 0, 1, 2.5f}));
  EXPECT_EQ(mesh->faces, (std::vector<uint32_t>{0, 1, 2, 0, 2, 3}));
  EXPECT_EQ(mesh->places,
            (std::vector<uint16_t>{0, 0, 65535, 0, 65535, 65535, 0, 0, 65535, 65535, 0, 32768}));
  EXPECT_EQ(mesh->jpeg, "a picture");
  PageInfo info;
  info.mesh = *mesh;
  const json page = first_of(small_reconstruction({kPinhole}), info);
  EXPECT_EQ(page["mesh"]["world"], 1);
  EXPECT_EQ(page["mesh"]["texture"], "YSBwaWN0dXJl");
  EXPECT_FALSE(first_of(small_reconstruction({kPinhole}), {}).contains("mesh"));
}

TEST(PageMesh, DamageIsNamed) {
  const TemporaryFolder temporary;
  for (const std::string line : {"f 1/1 2/2 5/3", "f 1/1 2/2", "f 0/1 2/2 3/3", "f 1/9 2/2 3/3", "v 1 2",
                                 "v 1 2 nan", "vt 1", "surface 1", "f 1 2 3"}) {
    write_square(temporary.path());
    std::ofstream(temporary.path() / "mesh.obj", std::ios::app) << line << "\n";
    const Result<PageMesh> mesh = read_page_mesh(temporary.path());
    ASSERT_FALSE(mesh.ok()) << line;
    EXPECT_NE(mesh.error().message.find("mesh.obj:14"), std::string::npos) << mesh.error().message;
  }
  for (const char* name : {"mesh.obj", "mesh.jpg", "export.json"}) {
    write_square(temporary.path());
    std::filesystem::remove(temporary.path() / name);
    const Result<PageMesh> mesh = read_page_mesh(temporary.path());
    ASSERT_FALSE(mesh.ok()) << name;
    EXPECT_NE(mesh.error().message.find(name), std::string::npos) << mesh.error().message;
  }
  write_square(temporary.path());
  write_text(temporary.path() / "mesh.jpg", std::string(4 << 20, 'x'));
  const Result<PageMesh> large = read_page_mesh(temporary.path());
  ASSERT_FALSE(large.ok());
  EXPECT_NE(large.error().message.find("--texture-side"), std::string::npos);
}

TEST(PageMesh, LiesBesideTheResult) {
  const TemporaryFolder temporary;
  std::filesystem::create_directories(temporary.path() / "out");
  EXPECT_TRUE(mesh_folder_of(temporary.path() / "out").empty());
  write_square(temporary.path() / "out-mesh");
  EXPECT_EQ(mesh_folder_of(temporary.path() / "out").filename(), "out-mesh");
  EXPECT_EQ(mesh_folder_of(temporary.path() / "out/").filename(), "out-mesh");
}

}  // namespace
}  // namespace raysfm
