#include "raysfm/camera_files/camera_file.h"

#include <gtest/gtest.h>

#include "support/camera_texts.h"
#include "support/changed_text.h"
#include "support/shared_data.h"
#include "support/temporary_folder.h"

namespace raysfm {
namespace {

using testing_support::with;

using namespace testing_support;

Result<Rig> parse(const std::string& text) {
  return parse_camera_file(text, "rig.yaml");
}

template <typename Model>
const Model& as(const Camera& camera) {
  return std::get<Model>(camera.model);
}

TEST(CameraFile, ReadsEveryFieldOfTheProjectsFormat) {
  const Result<Rig> rig = parse(kProjectYaml);
  ASSERT_TRUE(rig) << rig.error().message;
  ASSERT_EQ(rig->cameras.size(), 2u);
  const Camera& left = rig->cameras[0];
  EXPECT_EQ(left.name, "left");
  EXPECT_EQ(left.width, 640);
  EXPECT_EQ(left.height, 480);
  EXPECT_EQ(left.stream, 0);
  EXPECT_EQ(left.roi.w, 0);
  EXPECT_EQ(left.rig_from_cam.translation, Eigen::Vector3d::Zero());
  EXPECT_EQ(as<Radtan>(left).parameters(),
            (std::array<double, 9>{500, 501, 320.5, 240.25, -0.1, 0.02, 0.001, -0.002, 0}));
  const Camera& right = rig->cameras[1];
  EXPECT_EQ(as<Pinhole>(right).parameters(), (std::array<double, 4>{400, 400, 159.5, 119.5}));
  EXPECT_EQ(right.stream, 1);
  EXPECT_EQ(right.roi.x, 10);
  EXPECT_EQ(right.roi.y, 20);
  EXPECT_EQ(right.roi.h, 240);
  EXPECT_NEAR(right.rig_from_cam.rotation.angularDistance(Eigen::Quaterniond(0.8, 0, 0, 0.6)), 0, 1e-12);
  EXPECT_EQ(right.rig_from_cam.translation, Eigen::Vector3d(0.1, 0.2, 0.3));
}

TEST(CameraFile, WritesWhatItReads) {
  const TemporaryFolder folder;
  Rig rig = *parse(kProjectYaml);
  rig.cameras[0].name = "a \"strange\": name\\\n#";
  rig.cameras[0].mask_path = folder.file("m.png", "x").string();
  rig.cameras[0].shutter = {1. / 30, RollingShutter::Direction::kLeft};
  rig.cameras[1].model = Rational{1000. / 3, 500, 160, 120, .1, .2, 1e-7, 1. / 7000, .5, .6, .7, .8};
  ASSERT_TRUE(write_camera_file(rig, folder.path() / "camera.yaml"));
  const Result<Rig> again = read_camera_file(folder.path() / "camera.yaml");
  ASSERT_TRUE(again) << again.error().message;
  ASSERT_EQ(again->cameras.size(), 2u);
  EXPECT_EQ(again->cameras[0].name, rig.cameras[0].name);
  EXPECT_EQ(again->cameras[0].mask_path, rig.cameras[0].mask_path);
  EXPECT_NEAR(again->cameras[0].shutter.readout, 1. / 30, 1e-15);
  EXPECT_EQ(again->cameras[0].shutter.direction, RollingShutter::Direction::kLeft);
  EXPECT_EQ(again->cameras[1].shutter.readout, 0);
  EXPECT_EQ(as<Rational>(again->cameras[1]).parameters(), as<Rational>(rig.cameras[1]).parameters());
  EXPECT_EQ(format_camera_file(*again), format_camera_file(rig));
}

struct Broken {
  const char* what;
  const char* by;
  std::vector<const char*> message;  // parts that the message must have
};

TEST(CameraFile, SaysWhatIsWrongInOneLine) {
  const Broken cases[] = {
      {"raysfm_camera: 1", "raysfm_camera: 2", {"raysfm_camera", "'2'", "1 to 1"}},
      {"raysfm_camera: 1", "raysfm_cameras: 1", {"raysfm_camera", "missing"}},
      {"cameras:", "camera:", {"camera", "unknown field", "cameras"}},
      {"model: radtan", "model: fisheye", {"cameras[0].model", "'fisheye'", "pinhole, radtan, rational"}},
      {"model: radtan", "", {"cameras[0].model", "missing"}},
      {"fx: 500", "fx: -500", {"cameras[0].intrinsics.fx", "-500", "above 0"}},
      {"fx: 500", "fx: 0", {"cameras[0].intrinsics.fx", "above 0"}},
      {"fx: 500", "fx: .nan", {"cameras[0].intrinsics.fx", "'.nan'", "finite"}},
      {"fx: 500", "fx: nan", {"cameras[0].intrinsics.fx", "'nan'", "finite"}},
      {"fx: 500", "fx: 1e999", {"cameras[0].intrinsics.fx", "'1e999'", "finite"}},
      {"fx: 500", "fx: [1, 2]", {"cameras[0].intrinsics.fx", "a list of 2", "number"}},
      {"fx: 500", "fx: wide", {"cameras[0].intrinsics.fx", "'wide'", "number"}},
      {"fx: 500, ", "", {"cameras[0].intrinsics.fx", "missing", "number"}},
      {"fx: 500", "f: 500", {"cameras[0].intrinsics.f", "unknown field", "fx, fy"}},
      {"p2: -0.002", "p2: -0.002, k4: 1", {"cameras[0].intrinsics.k4", "unknown field"}},
      {"cx: 320.5", "cx: 1e7", {"cameras[0].intrinsics.cx", "1e6"}},
      {"[640, 480]", "[640]", {"cameras[0].resolution", "a list of 1", "[width, height]"}},
      {"[640, 480]", "[640, -480]", {"cameras[0].resolution[1]", "'-480'", "1 to"}},
      {"[640, 480]", "[640.5, 480]", {"cameras[0].resolution[0]", "'640.5'", "integer"}},
      {"[640, 480]", "[640, 99999999999999999999]", {"cameras[0].resolution[1]", "integer"}},
      {"[640, 480]", "big", {"cameras[0].resolution", "'big'"}},
      {"[0, 0, 0.6, 0.8]", "[0, 0, 0.6, 0.9]", {"cameras[1].rig_from_cam.rotation", "length", "1"}},
      {"[0, 0, 0.6, 0.8]", "[0, 0, 0]", {"cameras[1].rig_from_cam.rotation", "3 numbers", "4"}},
      {"[0.1, 0.2, 0.3]", "[0.1, 0.2, .inf]", {"cameras[1].rig_from_cam.translation", "finite"}},
      {"translation:", "position:", {"cameras[1].rig_from_cam.position", "unknown field"}},
      {"stream: 1", "stream: -1", {"cameras[1].stream", "'-1'", "0 to"}},
      {"roi: [10, 20, 320, 240]", "roi: [10, 20, 320]", {"cameras[1].roi", "a list of 3"}},
      {"roi: [10, 20, 320, 240]", "roi: [10, 20, 300, 240]", {"cameras[1].roi", "300 x 240", "320 x 240"}},
      {"name: right", "name: left", {"cameras[1].name", "'left'", "no other"}},
      {"name: right", "name: [right]", {"cameras[1].name", "text"}},
      {"name: right", "name: right\n    names: right", {"cameras[1].names", "unknown field"}},
      {"name: right", "name: right\n    name: right", {"'name'", "twice"}},
      {"stream: 1", "mask: \"\"", {"cameras[1].mask", "path"}},
      {"stream: 1",
       "rolling_shutter: {readout_ms: -3}",
       {"cameras[1].rolling_shutter.readout_ms", "-3", "0 to 1000"}},
      {"stream: 1", "rolling_shutter: {direction: down}", {"rolling_shutter.readout_ms"}},
      {"stream: 1",
       "rolling_shutter: {readout_ms: 3, direction: north}",
       {"rolling_shutter.direction", "'north'", "down, up, right or left"}},
      {"stream: 1", "rolling_shutter: {readout: 3}", {"rolling_shutter.readout", "unknown field"}},
      {"resolution: [640, 480]", "resolution: [640, 480", {"line", "YAML"}},
  };
  for (const Broken& broken : cases) {
    const Result<Rig> rig = parse(with(kProjectYaml, broken.what, broken.by));
    ASSERT_FALSE(rig) << broken.by;
    EXPECT_EQ(rig.error().kind, ErrorKind::kBadInput);
    const std::string& message = rig.error().message;
    EXPECT_EQ(message.find('\n'), std::string::npos) << message;
    EXPECT_TRUE(message.starts_with("rig.yaml: ")) << message;
    for (const char* part : broken.message) {
      EXPECT_NE(message.find(part), std::string::npos) << message << " lacks " << part;
    }
  }
}

TEST(CameraFile, RefusesCamerasThatSeeNothing) {
  EXPECT_FALSE(
      parse("raysfm_camera: 1\ncameras: [{name: a, model: radtan, resolution: [64, 48], intrinsics: "
            "{fx: 1, fy: 1, cx: -500, cy: 0, k1: -1000, k2: 0, p1: 0, p2: 0}}]"));
}

// Each model's own way of being no camera.
TEST(CameraFile, RefusesModelsThatCannotBe) {
  const Broken cases[] = {
      {"k1: 0.01, k2: -0.002", "k1: -30, k2: 0", {"fisheye.intrinsics", "stops rising"}},
      {"k1: 0.01, k2: -0.002", "k1: 0.01, k9: 1", {"cameras[0].intrinsics.k9", "unknown field"}},
      {"xi: 1.1, ", "", {"cameras[1].intrinsics.xi", "missing"}},
      {"xi: -0.2, alpha: 0.57", "xi: -0.2, alpha: 1.57", {"cameras[2].intrinsics.alpha", "1.57"}},
      {"alpha: 0.6, beta: 1.1", "alpha: 0.6, beta: -1.1", {"cameras[3].intrinsics.beta", "-1.1"}},
      {"a0: 200", "a0: -200", {"cameras[4].intrinsics.a0", "-200"}},
      {"a2: -0.001", "a2: 10", {"polynomial.intrinsics", "stops rising"}},
      {"c: 1.001, d: 0.002, e: -0.003", "c: 1, d: 1, e: 1", {"cameras[4].intrinsics.c"}},
      {"radius: 0.1", "radius: 0", {"cameras[6].mirror.radius", "0"}},
      {"rim: 0.083", "rim: 0.2", {"cameras[6].mirror.rim", "0.2"}},
      {"conic: 0", "conic: .nan", {"cameras[6].mirror.conic", "finite"}},
      {"apex: [0.0025, -0.0015, 0.4]", "apex: [0, 0, -0.4]", {"cameras[6].mirror.apex", "-0.4"}},
      {"apex: [0.0025, -0.0015, 0.4]", "apex: [0, 0]", {"cameras[6].mirror.apex", "2 numbers"}},
      {"rotation: [0, 0, 0, 1], body", "rotation: [0, 0, 0, 2], body", {"cameras[6].mirror.rotation"}},
      {"body: 0.022", "body: 0.022, size: 1", {"cameras[6].mirror.size", "unknown field"}},
      {"grid: [4, 4]", "grid: [4, 5]", {"cameras[7].table.directions", "48 numbers", "60"}},
      {"grid: [4, 4]", "grid: [3, 4]", {"cameras[7].table.grid[0]", "'3'"}},
      {"[-1.5, -1.5, 2,", "[0, 0, 0,", {"cameras[7].table", "length 0"}},
      {"[-1.5, -1.5, 2,", "[.nan, 0, 1,", {"cameras[7].table.directions", "'.nan'"}},
      {"area: [0, 0, 39, 29]", "area: [0, 0, -39, 29]", {"cameras[7].table.area[2]", "'-39'"}},
      {"    table:", "    intrinsics: {}\n    table:", {"cameras[7].intrinsics", "unknown field"}},
  };
  for (const Broken& broken : cases) {
    const Result<Rig> rig = parse(with(kManyModelsYaml, broken.what, broken.by));
    ASSERT_FALSE(rig) << broken.by;
    const std::string& message = rig.error().message;
    EXPECT_EQ(message.find('\n'), std::string::npos) << message;
    for (const char* part : broken.message) {
      EXPECT_NE(message.find(part), std::string::npos) << message << " lacks " << part;
    }
  }
}

TEST(CameraFile, RefusesWhatIsNoCameraFile) {
  for (const std::string text :
       {"", "\n\n# only a comment\n", "hello", "[1, 2]", "a: b", "raysfm_camera: 1\ncameras: []",
        "<html><body></body></html>", "{", "cam0: 3", "K: 3", "P0: 1 2 3", "1 PINHOLE 3 4 5"}) {
    const Result<Rig> rig = parse(text);
    ASSERT_FALSE(rig) << text;
    EXPECT_EQ(rig.error().kind, ErrorKind::kBadInput);
    EXPECT_EQ(rig.error().message.find('\n'), std::string::npos);
  }
}

TEST(CameraFile, MasksAreBesideTheFileAndMustExist) {
  const TemporaryFolder folder;
  const std::string text = with(kProjectYaml, "stream: 1", "mask: m.png");
  folder.file("camera.yaml", text);
  const Result<Rig> missing = read_camera_file(folder.path() / "camera.yaml");
  ASSERT_FALSE(missing);
  EXPECT_NE(missing.error().message.find("m.png"), std::string::npos);
  folder.file("m.png", "x");
  const Result<Rig> rig = read_camera_file(folder.path() / "camera.yaml");
  ASSERT_TRUE(rig) << rig.error().message;
  EXPECT_EQ(rig->cameras[1].mask_path, (folder.path() / "m.png").string());
}

TEST(CameraFile, FilesThatCannotBeReadAreNamed) {
  const TemporaryFolder folder;
  for (const auto& path :
       {folder.path(), folder.path() / "missing.yaml", folder.file("binary", std::string(50, '\0'))}) {
    const Result<Rig> rig = read_camera_file(path);
    ASSERT_FALSE(rig);
    EXPECT_NE(rig.error().message.find(path.string()), std::string::npos) << rig.error().message;
  }
  const auto large = folder.file("large.yaml", "");
  std::filesystem::resize_file(large, 17 << 20);
  EXPECT_NE(read_camera_file(large).error().message.find("bytes"), std::string::npos);
}

// The data set of EuRoC describes its rig in two forms.
TEST(CameraFile, KalibrAndEurocAgreeOnTheSameRig) {
  RAYSFM_SKIP_WITHOUT_SHARED_DATA("calibrations");
  const Result<Rig> kalibr = read_camera_file(shared_data("calibrations/kalibr/euroc_mav.yaml"));
  const Result<Rig> cam0 = read_camera_file(shared_data("calibrations/euroc/cam0-sensor.yaml"));
  const Result<Rig> cam1 = read_camera_file(shared_data("calibrations/euroc/cam1-sensor.yaml"));
  ASSERT_TRUE(kalibr && cam0 && cam1);
  const Rigid3 a = kalibr->cameras[0].rig_from_cam.inverse() * kalibr->cameras[1].rig_from_cam;
  const Rigid3 b = cam0->cameras[0].rig_from_cam.inverse() * cam1->cameras[0].rig_from_cam;
  EXPECT_LT((a.translation - b.translation).norm(), 1e-9);
  EXPECT_LT(a.rotation.angularDistance(b.rotation), 1e-9);
  EXPECT_EQ(as<Radtan>(kalibr->cameras[1]).parameters(), as<Radtan>(cam1->cameras[0]).parameters());
  EXPECT_NEAR(a.translation.x(), 0.11, 0.001);  // the baseline of the VI sensor, to the right
}

}  // namespace
}  // namespace raysfm
