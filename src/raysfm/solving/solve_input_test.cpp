// What `solve` says to inputs that are wrong or tell too little, and what it takes.
#include "raysfm/solving/solve_input.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>

#include "raysfm/api/solve.h"
#include "raysfm/files/text_file.h"
#include "raysfm/frames/image_writer.h"
#include "raysfm/frames/png_chunks.h"
#include "raysfm/solving/solve_photos.h"
#include "support/exif_bytes.h"
#include "support/temporary_folder.h"
#include "support/test_scenes.h"

namespace raysfm {
namespace {

namespace fs = std::filesystem;
using test_scenes::Cube;

class SolveInputTest : public testing::Test {
 protected:
  std::string path(const char* name) const { return (folder_.path() / name).string(); }
  void write(const char* name, const std::string& content) const {
    std::ofstream(path(name), std::ios::binary) << content;
  }
  void write_tracks(const PointTracks& tracks) const {
    std::string text = "image,point,u,v\n";
    for (int k = 0; k < tracks.size(); ++k) {
      text += fmt::format("{},p{},{:.4f},{:.4f}\n", tracks.image[k], tracks.point[k], tracks.pixel[k].x(),
                          tracks.pixel[k].y());
    }
    write("tracks.csv", text);
  }
  SolveSettings settings() const {
    SolveSettings settings;
    settings.input = path("tracks.csv");
    settings.size = "501x501";
    return settings;
  }
  // The message without the name of the input, and the exit code.
  std::string failure(const SolveSettings& settings, int* code) const {
    const Result<SolveResult> result = solve(settings, {});
    *code = result ? 0 : result.error().kind == ErrorKind::kBadInput ? 2 : 3;
    if (result) return result->report.lens->degenerate;
    const std::string& message = result.error().message;
    EXPECT_EQ(message.find('\n'), std::string::npos) << message;
    return message.starts_with(settings.input) ? message.substr(settings.input.size()) : message;
  }
  void expect_failure(int code, const std::string& part, const SolveSettings& settings) const {
    int found = 0;
    const std::string message = failure(settings, &found);
    EXPECT_EQ(found, code) << message;
    EXPECT_NE(message.find(part), std::string::npos) << message;
  }

  testing_support::TemporaryFolder folder_;
};

Cube make_cube(int images, int points) {
  Rng rng(7);
  return test_scenes::make_cube({.images = images, .points = points}, &rng);
}

TEST_F(SolveInputTest, TooLittleIsSaidWithTheLeast) {
  write_tracks(make_cube(1, 40).tracks);
  expect_failure(3,
                 "images: 1 with at least 8 points, at least 2 are needed (known of the lenses:", settings());
  write_tracks(make_cube(5, 7).tracks);
  expect_failure(3, "images: 0 with at least 8 points, at least 2 are needed", settings());
  Cube apart = make_cube(2, 40);
  for (int k = 0; k < apart.tracks.size(); ++k) apart.tracks.point[k] += 40 * apart.tracks.image[k];
  apart.tracks.point_count = 80;
  write_tracks(apart.tracks);
  expect_failure(3, "no two images share 8 points", settings());
}

TEST_F(SolveInputTest, DegenerateViewsAreNamed) {
  const Cube cube = make_cube(6, 60);
  Cube still = cube, turning = cube, flat = cube;
  Rng rng(1);
  for (Rigid3& pose : still.truth.cam_from_world) pose = cube.truth.cam_from_world[0];
  test_scenes::project_all(still.truth, &still.tracks);
  test_scenes::add_noise(0.2, &rng, &still.tracks);
  write_tracks(still.tracks);
  expect_failure(3, "no parallax", settings());
  for (Rigid3& pose : turning.truth.cam_from_world) {
    const Eigen::Quaterniond r = exp_so3({0.1 * rng.normal(), 0.1 * rng.normal(), 0.1 * rng.normal()});
    pose = {r, r * Eigen::Vector3d(0, 0, 5)};
  }
  test_scenes::project_all(turning.truth, &turning.tracks);
  test_scenes::add_noise(0.2, &rng, &turning.tracks);
  write_tracks(turning.tracks);
  expect_failure(3, "pure rotation", settings());
  for (Eigen::Vector3d& x : flat.truth.points) x.z() = 0;
  test_scenes::project_all(flat.truth, &flat.tracks);
  test_scenes::add_noise(0.2, &rng, &flat.tracks);
  write_tracks(flat.tracks);
  expect_failure(3, "planar scene", settings());
}

TEST_F(SolveInputTest, WrongFilesAreNamed) {
  write("tracks.csv", "");
  expect_failure(2, ":1: '' is not allowed, the header line image,point,u,v is", settings());
  write("tracks.csv", std::string("\x7f"
                                  "ELF\0\1\2\3\n\0\0",
                                  11));
  expect_failure(2, "is not allowed, the header line image,point,u,v is", settings());
  write("tracks.csv", "image,point,u,v\n0,0,nan,1\n");
  expect_failure(2, ":2: u = 'nan' is not allowed", settings());
  write("tracks.csv", "image,point,u,v\n0,0,1,1\n0,0,1,1\n");
  expect_failure(2, ":3: point '0' is seen in image '0' a second time", settings());
  write("tracks.csv", "image,point,u,v\n99999999999999999999,18446744073709551616,1,1\n");
  expect_failure(3, "images: 0 with at least 8 points", settings());
  SolveSettings missing = settings();
  missing.input = path("nothing.csv");
  expect_failure(2, "no such file", missing);
  write("tracks.csv", "image,point,u,v\n0,0,-5,-5\n");
  SolveSettings no_size = settings();
  no_size.size = "";
  expect_failure(2, "give it with --size", no_size);
}

TEST_F(SolveInputTest, KnownStructureOfAPlaneGivesTheLens) {
  Cube cube = make_cube(6, 40);
  for (Eigen::Vector3d& x : cube.truth.points) x.z() = 0;
  test_scenes::project_all(cube.truth, &cube.tracks);
  write_tracks(cube.tracks);
  std::string text = "point,x,y,z\n";
  for (int i = 0; i < 39; ++i) {  // one is not known
    const Eigen::Vector3d& x = cube.truth.points[i];
    text += fmt::format("p{},{:.9f},{:.9f},{:.9f}\n", i, x.x(), x.y(), x.z());
  }
  write("board.csv", text);
  SolveSettings known = settings();
  known.structure = path("board.csv");
  std::string said;
  SolveCallbacks callbacks;
  callbacks.event = [&](const Event& e) { said += e.message + "\n"; };
  const auto result = solve(known, callbacks);
  ASSERT_TRUE(result.ok()) << result.error().message;
  EXPECT_NE(said.find("1 of 40 points are not in"), std::string::npos) << said;
  const Reconstruction& r = result->reconstruction;
  EXPECT_TRUE(r.metric_scale);
  for (size_t j = 0; j < 6; ++j) {
    ASSERT_TRUE(r.frames[j].world_from_rig);
    EXPECT_NEAR(lens_of(r.lenses[r.frames[j].lens])->fx, 1000, 0.05);
    const Eigen::Vector3d place = cube.truth.cam_from_world[j].inverse().translation;
    EXPECT_LT((r.frames[j].world_from_rig->translation - place).norm(), 1e-3);
  }
  EXPECT_EQ(r.points.size(), 39u);
}

TEST_F(SolveInputTest, StructureThatDoesNotFitIsNamed) {
  write_tracks(make_cube(3, 20).tracks);
  SolveSettings known = settings();
  known.structure = path("board.csv");
  expect_failure(2, "board.csv", known);
  write("board.csv", "point,x,y,z\nother,0,0,0\n");
  expect_failure(2, "has none of the points of", known);
  write("board.csv", "point,x,y,z\n");
  expect_failure(2, "has none of the points of", known);
  write("board.csv", "point,x,y,z\np0,0,0,0\np1,1,0,0\np2,0,1,0\n");
  expect_failure(3, "known structure: no image agrees with it in 6 points", known);
  known.input = folder_.path().string();
  expect_failure(2, "allowed with a file of tracks only", known);
}

TEST_F(SolveInputTest, TracksAreInOrderWhereEachImageSeesWhatTheOneBeforeSaw) {
  PointTracks tracks;
  tracks.image_count = 50;
  tracks.point_count = 70;
  for (int j = 0; j < 50; ++j) {
    for (int i = j; i < j + 20; ++i) tracks.add(j, i, {double(i), double(j)});
  }
  EXPECT_EQ(shared_with_previous(tracks)[0], 0);
  EXPECT_EQ(shared_with_previous(tracks)[49], 19);
  write_tracks(tracks);
  EXPECT_TRUE(tracks_from_file(settings(), {})->in_order);
  for (int& image : tracks.image) image = image * 7 % 50;
  write_tracks(tracks);
  EXPECT_FALSE(tracks_from_file(settings(), {})->in_order);
}

// Squares at random on grey, moved by `shift` pixels.
GrayImage picture(int width, int height, int shift) {
  Rng rng(5);
  GrayImage image(width, height);
  for (int y = 0; y < height; ++y) std::fill_n(image.row(y), width, uint8_t{128});
  for (int i = 0; i < 400; ++i) {
    const int x0 = static_cast<int>(rng.index(600)) - 100 + shift, y0 = static_cast<int>(rng.index(400)) - 50;
    const int side = 4 + static_cast<int>(rng.index(20));
    const auto grey = static_cast<uint8_t>(rng.index(256));
    for (int y = std::max(0, y0); y < std::min(height, y0 + side); ++y) {
      for (int x = std::max(0, x0); x < std::min(width, x0 + side); ++x) image.row(y)[x] = grey;
    }
  }
  return image;
}

TEST_F(SolveInputTest, PhotosOfDifferentSizesAreCentredInOne) {
  const fs::path photos = folder_.path() / "photos";
  fs::create_directories(photos);
  ASSERT_TRUE(write_png(photos / "0.png", picture(320, 240, 0).view()));
  ASSERT_TRUE(write_png(photos / "1.png", picture(300, 260, 0).view()));
  SolveSettings images;
  images.input = photos.string();
  std::string said;
  SolveCallbacks callbacks;
  callbacks.event = [&](const Event& e) { said += e.message + "\n"; };
  const auto input = tracks_from_images(images, callbacks);
  ASSERT_TRUE(input.ok()) << input.error().message;
  EXPECT_NE(said.find("1.png is 300x260, the first image 320x240"), std::string::npos) << said;
  EXPECT_FALSE(input->in_order);
  EXPECT_EQ(input->tracks.image_size, Eigen::Vector2d(320, 260));
  EXPECT_EQ(input->shift(0), Eigen::Vector2d(0, 10));
  EXPECT_EQ(input->shift(1), Eigen::Vector2d(10, 0));
  // The pictures have their upper left corner in common.
  ASSERT_GT(input->tracks.point_count, 20);
  int off = 0;
  std::vector<Eigen::Vector2d> first(input->tracks.point_count, Eigen::Vector2d::Zero());
  for (int k = 0; k < input->tracks.size(); ++k) {
    const Eigen::Vector2d pixel = input->tracks.pixel[k] - input->shift(input->tracks.image[k]);
    Eigen::Vector2d& at = first[input->tracks.point[k]];
    if (input->tracks.image[k] == 0) at = pixel;
    off += input->tracks.image[k] == 1 && (pixel - at).norm() > 1;
  }
  EXPECT_LT(off, 0.05 * input->tracks.point_count);
  images.images = "video";
  const auto video = tracks_from_images(images, {});
  ASSERT_TRUE(video.ok()) << video.error().message;
  EXPECT_EQ(video->defects[0], "");
  EXPECT_NE(video->defects[1].find("300 x 260 pixels"), std::string::npos) << video->defects[1];
}

TEST_F(SolveInputTest, ExifOfPhotosIsNamedAndThatOfACropNotUsed) {
  const fs::path photos = folder_.path() / "photos";
  fs::create_directories(photos);
  constexpr size_t kHead = 33;  // bytes of a PNG before what may follow its header
  for (int i = 0; i < 2; ++i) {
    const fs::path path = photos / (std::to_string(i) + ".png");
    ASSERT_TRUE(write_png(path, picture(320, 240, 3 * i).view()));
    std::string bytes = *read_text_file(path, 1 << 24);
    const testing_support::ExifText text{.maker = "Acme", .focal_35mm = 26, .width = 320, .height = 240};
    bytes.insert(kHead, testing_support::chunk_of_png("eXIf", testing_support::exif_bytes(text, i == 0)));
    std::ofstream(path, std::ios::binary) << bytes;
  }
  SolveSettings images;
  images.input = photos.string();
  std::string said;
  SolveCallbacks callbacks;
  callbacks.event = [&](const Event& e) { said += e.message + "\n"; };
  auto input = tracks_from_photos(images, callbacks);
  ASSERT_TRUE(input.ok()) << input.error().message;
  ASSERT_EQ(input->exif.size(), 1u);
  EXPECT_EQ(input->exif[0].photos, 2);
  EXPECT_NEAR(input->exif[0].focal_px, 26 * 400 / std::hypot(36, 24), 1e-9);
  EXPECT_NE(
      said.find("EXIF of 0.png and 1 more, by Acme: 240 px, give or take 8 (26 mm in the form of 35 mm); "
                "used as a prior"),
      std::string::npos)
      << said;
  const std::string whole = *read_text_file(photos / "1.png", 1 << 24);
  ASSERT_TRUE(write_png(photos / "1.png", picture(300, 240, 3).view()));
  std::string cropped = *read_text_file(photos / "1.png", 1 << 24);
  const size_t chunk = big_endian(std::string_view(whole).substr(kHead)) + 12;
  std::ofstream(photos / "1.png", std::ios::binary) << cropped.insert(kHead, whole.substr(kHead, chunk));
  said.clear();
  input = tracks_from_photos(images, callbacks);
  ASSERT_TRUE(input.ok()) << input.error().message;
  ASSERT_EQ(input->exif.size(), 2u);
  EXPECT_NE(
      said.find("1.png, by Acme; not used: is of a photo of 320x240 pixels, this one has 300x240: cropped"),
      std::string::npos)
      << said;
  EXPECT_NE(input->exif[0].not_used, "");
}

TEST_F(SolveInputTest, LargeStepsArePhotosAndSmallOnesAVideo) {
  const fs::path photos = folder_.path() / "photos";
  fs::create_directories(photos);
  for (int i = 0; i < 3; ++i) {
    ASSERT_TRUE(write_png(photos / (std::to_string(i) + ".png"), picture(320, 240, 3 * i).view()));
  }
  SolveSettings images;
  images.input = photos.string();
  EXPECT_TRUE(tracks_from_images(images, {})->in_order);
  images.images = "photos";
  EXPECT_FALSE(tracks_from_images(images, {})->in_order);
  ASSERT_TRUE(write_png(photos / "3.png", picture(320, 240, 290).view()));
  images.images = "auto";
  EXPECT_FALSE(tracks_from_images(images, {})->in_order);
}

}  // namespace
}  // namespace raysfm
