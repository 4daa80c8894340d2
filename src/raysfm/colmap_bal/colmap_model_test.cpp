// COLMAP itself is the judge of both formats: what it converts must read as the same model.
#include "raysfm/colmap_bal/colmap_model.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>

#include "raysfm/colmap_bal/colmap_file.h"
#include "raysfm/files/little_endian.h"
#include "support/shell.h"
#include "support/small_reconstruction.h"
#include "support/temporary_folder.h"

namespace raysfm {
namespace {

namespace fs = std::filesystem;
using testing_support::content_of;
using testing_support::run;
using testing_support::small_reconstruction;
using testing_support::TemporaryFolder;

// A camera of every model that COLMAP 3.8 knows; an image without keypoints, keypoints without points, a
// point without a track, one that a single image sees, names with spaces.
ColmapFiles small_text() {
  ColmapFiles files{.binary = false, .cameras = {}, .images = {}, .points = {}};
  files.cameras =
      "# a comment\n"
      "1 SIMPLE_PINHOLE 640 480 500.5 320 240\n"
      "2 PINHOLE 640 480 500 501 320 240\n\n"
      "3 SIMPLE_RADIAL 640 480 500 320 240 0.1\n"
      "4 RADIAL 640 480 500 320 240 0.1 -0.02\n"
      "5 OPENCV 640 480 500 501 320 240 0.1 -0.02 0.001 0.002\n"
      "6 OPENCV_FISHEYE 640 480 500 501 320 240 0.1 -0.02 0.001 0.002\n"
      "7 FULL_OPENCV 640 480 500 501 320 240 0.1 -0.02 0.001 0.002 0.1 0.2 0.3 0.4\n"
      "8 FOV 640 480 500 501 320 240 0.9\n"
      "9 SIMPLE_RADIAL_FISHEYE 640 480 500 320 240 0.1\n"
      "10 RADIAL_FISHEYE 640 480 500 320 240 0.1 -0.02\n"
      "4000000000 THIN_PRISM_FISHEYE 640 480 500 501 320 240 1 2 3 4 5 6 7 8\n";
  files.images =
      "# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME\n"
      "7 0.5 0.5 0.5 0.5 1 2 3 1 first image.jpg\n"
      "1.5 2.5 -1 100.25 200.125 10 3 4 11 8 9 -1\n"
      "3 2 0 0 0 0.1 0.2 0.3 4000000000 cam/second.png\r\n"
      "10 20 10\r\n"
      "5 1 0 0 0 0 0 0 1 empty.png\n"
      "\n";
  files.points =
      "10 1.5 2.5 3.5 255 128 0 0.75 7 1 3 0\n"
      "11 0.1 0.2 0.3 1 2 3 -1 7 2\n"
      "18446744073709551614 4 5 6 7 8 9 -1\n";
  return files;
}

ColmapModel parsed(const ColmapFiles& files) {
  Result<ColmapModel> model = parse_colmap(files, "folder");
  if (!model) ADD_FAILURE() << model.error().message;
  return model ? *std::move(model) : ColmapModel{};
}

// The same with every record in the order of its identifier: COLMAP keeps none.
ColmapModel in_order(ColmapModel model) {
  std::ranges::sort(model.cameras, {}, &ColmapCamera::id);
  std::ranges::sort(model.images, {}, &ColmapImage::id);
  std::ranges::sort(model.points, {}, &ColmapPoint::id);
  return model;
}

void expect_same(ColmapModel a, ColmapModel b) {
  a = in_order(std::move(a));
  b = in_order(std::move(b));
  a.binary = b.binary = true;
  const ColmapFiles x = format_colmap(a), y = format_colmap(b);
  EXPECT_EQ(x.cameras, y.cameras);
  EXPECT_EQ(x.images, y.images);
  EXPECT_EQ(x.points, y.points);
}

TEST(ColmapModel, ReadsText) {
  const ColmapModel model = parsed(small_text());
  ASSERT_EQ(model.cameras.size(), 11u);
  EXPECT_EQ(model.cameras[0].parameters, (std::vector<double>{500.5, 320, 240}));
  EXPECT_EQ(model.cameras[10].id, 4000000000u);
  EXPECT_EQ(model.cameras[10].model, 10);
  EXPECT_EQ(model.cameras[10].width, 640u);
  ASSERT_EQ(model.images.size(), 3u);
  EXPECT_EQ(model.images[0].name, "first image.jpg");
  EXPECT_EQ(model.images[0].translation, (std::array<double, 3>{1, 2, 3}));
  EXPECT_EQ(model.images[1].name, "cam/second.png");
  EXPECT_EQ(model.images[1].camera, 10);
  EXPECT_EQ(model.images[1].rotation[0], 2);
  EXPECT_EQ(model.images[2].first_keypoint, model.images[2].last_keypoint);
  ASSERT_EQ(model.keypoints.size(), 5u);
  EXPECT_EQ(model.keypoints[0].point_id, kNoColmapPoint);
  EXPECT_EQ(model.keypoints[1].x, 100.25);
  EXPECT_EQ(model.keypoints[4].point_id, 10u);
  ASSERT_EQ(model.points.size(), 3u);
  EXPECT_EQ(model.points[0].rgb, (std::array<uint8_t, 3>{255, 128, 0}));
  EXPECT_EQ(model.points[0].error, 0.75);
  EXPECT_EQ(model.points[2].id, 18446744073709551614u);
  ASSERT_EQ(model.elements.size(), 3u);
  EXPECT_EQ(model.elements[1].image, 1);
  // A quaternion of any length is a rotation.
  EXPECT_EQ(colmap_pose(model.images[1]).rotation.w(), 1);
}

TEST(ColmapModel, TextAndBinaryComeBackAsTheyWere) {
  ColmapModel model = parsed(small_text());
  const ColmapFiles text = format_colmap(model);
  expect_same(parsed(text), model);
  EXPECT_EQ(format_colmap(parsed(text)).images, text.images);
  model.binary = true;
  const ColmapFiles bytes = format_colmap(model);
  const ColmapFiles again = format_colmap(parsed(bytes));
  EXPECT_EQ(again.cameras, bytes.cameras);
  EXPECT_EQ(again.images, bytes.images);
  EXPECT_EQ(again.points, bytes.points);
}

TEST(ColmapModel, ColmapReadsAndWritesTheSame) {
  if (!run("colmap help")) GTEST_SKIP() << "colmap is not installed";
  const TemporaryFolder folder;
  // COLMAP's text reader ends a name at a space and a point without a track is none to it.
  ColmapFiles files = small_text();
  files.images.replace(files.images.find("first image"), 11, "first_image");
  files.points.resize(files.points.find("18446744073709551614"));
  ColmapModel model = parsed(files);
  model.images[1].rotation[0] = 1;  // COLMAP writes them with unit length
  const auto convert = [&](const char* from, const char* to, const char* kind) {
    fs::create_directories(folder.path() / to);
    return run("colmap model_converter --input_path '" + (folder.path() / from).string() +
               "' --output_path '" + (folder.path() / to).string() + "' --output_type " + kind);
  };
  ASSERT_TRUE(write_colmap_model(model, folder.path() / "our_text"));
  model.binary = true;
  ASSERT_TRUE(write_colmap_model(model, folder.path() / "our_binary"));
  ASSERT_TRUE(convert("our_text", "a", "BIN"));
  ASSERT_TRUE(convert("our_binary", "b", "TXT"));
  for (const char* converted : {"a", "b"}) {
    const Result<ColmapModel> read = read_colmap_model(folder.path() / converted);
    ASSERT_TRUE(read) << read.error().message;
    expect_same(*read, model);
  }
  // Byte by byte, what COLMAP wrote itself.
  const ColmapModel theirs = *read_colmap_model(folder.path() / "a");
  ASSERT_TRUE(write_colmap_model(theirs, folder.path() / "ours"));
  for (const char* file : {"cameras.bin", "images.bin", "points3D.bin"}) {
    EXPECT_EQ(content_of(folder.path() / "ours" / file), content_of(folder.path() / "a" / file)) << file;
  }
}

TEST(ColmapModel, ReadsWhatTheTrackingWrites) {
  const TemporaryFolder folder;
  const Reconstruction reconstruction =
      small_reconstruction({Pinhole{500, 510, 319.5, 239.5}, Radtan{500, 510, 320, 240, -0.125, 0.25}});
  ASSERT_TRUE(write_colmap_model(reconstruction, folder.path()));
  const Result<ColmapModel> model = read_colmap_model(folder.path());
  ASSERT_TRUE(model) << model.error().message;
  EXPECT_TRUE(model->binary);
  EXPECT_EQ(model->images.size(), 8u);
  EXPECT_EQ(model->elements.size(), reconstruction.observations.size());
}

// What reading the text with one passage replaced says, less the folder.
std::string refusal(std::string ColmapFiles::*file, const std::string& from, const std::string& to) {
  ColmapFiles files = small_text();
  std::string& text = files.*file;
  const size_t at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  text.replace(at, from.size(), to);
  const Result<ColmapModel> model = parse_colmap(files, "");
  if (model) return "accepted";
  EXPECT_EQ(model.error().kind, ErrorKind::kBadInput);
  EXPECT_EQ(model.error().message.find('\n'), std::string::npos);
  return model.error().message;
}

TEST(ColmapModel, RefusesWrongCameras) {
  EXPECT_EQ(refusal(&ColmapFiles::cameras, "2 PINHOLE", "2 PINHOLES").substr(0, 60),
            "cameras.txt:3: MODEL: 'PINHOLES' is not allowed, SIMPLE_PINH");
  EXPECT_EQ(refusal(&ColmapFiles::cameras, "2 PINHOLE", "1 PINHOLE"),
            "cameras.txt: camera 1: a second time is not allowed, each identifier once is");
  EXPECT_EQ(refusal(&ColmapFiles::cameras, "500.5", "nan"),
            "cameras.txt:2: PARAMS: 'nan' is not allowed, a finite number is");
  EXPECT_EQ(refusal(&ColmapFiles::cameras, "500.5", ""), "cameras.txt:2: the line ends before PARAMS");
  EXPECT_EQ(refusal(&ColmapFiles::cameras, "500.5", "500 5"),
            "cameras.txt:2: PARAMS: '240' is not allowed, SIMPLE_PINHOLE has 3 parameters");
  EXPECT_EQ(refusal(&ColmapFiles::cameras, "640", "-640"),
            "cameras.txt:2: WIDTH: '-640' is not allowed, a whole number from 0 to 18446744073709551615 is");
}

TEST(ColmapModel, RefusesWrongImages) {
  EXPECT_EQ(refusal(&ColmapFiles::images, "1 2 3 1 first", "1 2 3 77 first"),
            "images.txt: image 7: camera 77 is not allowed, those of cameras.txt are");
  EXPECT_EQ(refusal(&ColmapFiles::images, "3 2 0 0 0", "7 2 0 0 0"),
            "images.txt: image 7: a second time is not allowed, each identifier once is");
  EXPECT_EQ(refusal(&ColmapFiles::images, "3 2 0 0 0", "3 0 0 0 0"),
            "images.txt: image 3: a quaternion of length 0 is not allowed, one above 0 is");
  EXPECT_EQ(
      refusal(&ColmapFiles::images, "empty.png\n\n", "empty.png\n"),
      "images.txt:6: the line with the keypoints of image 5 is missing behind this one, it may be empty");
  EXPECT_EQ(refusal(&ColmapFiles::images, "8 9 -1", "8 9"), "images.txt:3: the line ends before POINT3D_ID");
  EXPECT_EQ(
      refusal(&ColmapFiles::images, "8 9 -1", "8 9 12"),
      "images.txt: image 7 keypoint 3: point 12 is not allowed, a point of points3D.txt with this keypoint "
      "in its track is");
  EXPECT_EQ(refusal(&ColmapFiles::images, "8 9 -1", "8 inf -1"),
            "images.txt:3: Y: 'inf' is not allowed, a finite number is");
}

TEST(ColmapModel, RefusesWrongPoints) {
  EXPECT_EQ(
      refusal(&ColmapFiles::points, "7 1 3 0", "7 4 3 0"),
      "points3D.txt: point 10: image 7 keypoint 4 is not allowed in its track, the image has 4 keypoints");
  EXPECT_EQ(refusal(&ColmapFiles::points, "7 1 3 0", "7 1 4 0"),
            "points3D.txt: point 10: image 4 keypoint 0 is not allowed in its track, only images of "
            "images.txt are");
  EXPECT_EQ(refusal(&ColmapFiles::points, "7 1 3 0", "7 1 7 1"),
            "points3D.txt: point 10: image 7 keypoint 1 is not allowed in its track, it is there already");
  EXPECT_EQ(refusal(&ColmapFiles::points, "7 1 3 0", "7 2 3 0"),
            "points3D.txt: point 10: image 7 keypoint 2 is not allowed in its track, the keypoint belongs to "
            "another");
  EXPECT_EQ(refusal(&ColmapFiles::points, "18446744073709551614", "11"),
            "points3D.txt: point 11: a second time is not allowed, each identifier once is");
  EXPECT_EQ(refusal(&ColmapFiles::points, "255 128 0", "256 128 0"),
            "points3D.txt:1: R: '256' is not allowed, a whole number from 0 to 255 is");
  EXPECT_EQ(refusal(&ColmapFiles::points, "7 1 3 0", "7 1 3"),
            "points3D.txt:1: the line ends before POINT2D_IDX");
}

ColmapFiles small_binary() {
  ColmapModel model = parsed(small_text());
  model.binary = true;
  return format_colmap(model);
}

std::string refusal(const ColmapFiles& files) {
  const Result<ColmapModel> model = parse_colmap(files, "");
  return model ? "accepted" : model.error().message;
}

TEST(ColmapModel, BinaryCutOffAnywhereOrTooLong) {
  for (std::string ColmapFiles::*file : {&ColmapFiles::cameras, &ColmapFiles::images, &ColmapFiles::points}) {
    const ColmapFiles whole = small_binary();
    for (size_t length = 0; length < (whole.*file).size(); ++length) {
      ColmapFiles files = whole;
      (files.*file).resize(length);
      EXPECT_NE(refusal(files), "accepted") << length;
    }
    ColmapFiles files = whole;
    (files.*file) += '\0';
    EXPECT_NE(refusal(files).find(": 1 bytes behind the last"), std::string::npos);
  }
}

TEST(ColmapModel, BinaryCountsThatLie) {
  ColmapFiles files = small_binary();
  files.points.clear();
  append_little_endian<uint64_t>(files.points, uint64_t{1} << 60);
  files.points += std::string(102, '\0');
  EXPECT_EQ(
      refusal(files),
      "points3D.bin: number of points: 1152921504606846976 is not allowed, at most 2 fit into the 102 bytes "
      "that follow");
  files = small_binary();
  files.cameras[12] = 99;
  EXPECT_EQ(refusal(files), "cameras.bin: camera 1: model: 99 is not allowed, 0 to 17 are");
}

TEST(ColmapModel, FoldersThatHoldNoneOrAPart) {
  const TemporaryFolder folder;
  const auto says = [&] { return read_colmap_model(folder.path()).error().message; };
  EXPECT_FALSE(is_colmap_model(folder.path()));
  EXPECT_EQ(says(), (folder.path() / "cameras.bin").string() + ": no such file");
  const ColmapFiles text = small_text(), binary = small_binary();
  folder.file("cameras.txt", text.cameras);
  folder.file("images.txt", text.images);
  EXPECT_TRUE(is_colmap_model(folder.path()));
  EXPECT_EQ(says(), (folder.path() / "points3D.txt").string() + ": no such file");
  folder.file("points3D.txt", text.points);
  EXPECT_FALSE(read_colmap_model(folder.path())->binary);
  folder.file("cameras.bin", binary.cameras);
  folder.file("images.bin", binary.images);
  EXPECT_FALSE(read_colmap_model(folder.path())->binary);
  folder.file("points3D.bin", binary.points);
  EXPECT_TRUE(read_colmap_model(folder.path())->binary);
}

}  // namespace
}  // namespace raysfm
