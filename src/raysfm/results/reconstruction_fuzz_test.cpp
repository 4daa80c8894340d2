// Random damage to the files that `adjust` reads: whatever comes in, a model that holds together or one line
// comes out.
#include <gtest/gtest.h>

#include <algorithm>

#include "raysfm/colmap_bal/bal_file.h"
#include "raysfm/colmap_bal/colmap_file.h"
#include "raysfm/colmap_bal/colmap_model.h"
#include "raysfm/core/random.h"
#include "support/damage.h"
#include "support/small_reconstruction.h"
#include "support/temporary_folder.h"

namespace raysfm {
namespace {

using testing_support::expect_line;

void expect_bal_or_line(const std::string& text) {
  const Result<BalFile> file = parse_bal(text, "file");
  if (!file) return expect_line(file.error());
  for (const BalObservation& o : file->observations) {
    ASSERT_LT(static_cast<size_t>(o.camera), file->cameras.size());
    ASSERT_LT(static_cast<size_t>(o.point), file->points.size());
    ASSERT_TRUE(o.pixel.allFinite());
  }
  const std::string written = format_bal(*file);
  const Result<BalFile> again = parse_bal(written, "file");
  ASSERT_TRUE(again) << again.error().message;
  ASSERT_EQ(format_bal(*again), written);
}

void expect_model_or_line(const ColmapFiles& files) {
  const Result<ColmapModel> model = parse_colmap(files, "folder");
  if (!model) return expect_line(model.error());
  for (const ColmapImage& image : model->images) {
    ASSERT_LT(static_cast<size_t>(image.camera), model->cameras.size());
    ASSERT_NEAR(colmap_pose(image).rotation.norm(), 1, 1e-9);
  }
  for (const ColmapTrackElement& element : model->elements) {
    const ColmapImage& image = model->images.at(element.image);
    ASSERT_LT(element.keypoint, image.last_keypoint - image.first_keypoint);
  }
  const ColmapFiles written = format_colmap(*model);
  if (files.binary) {
    ASSERT_EQ(written.cameras, files.cameras);
    ASSERT_EQ(written.images, files.images);
    ASSERT_EQ(written.points, files.points);
  }
  const Result<ColmapModel> again = parse_colmap(written, "folder");
  ASSERT_TRUE(again) << again.error().message;
  for (const ColmapCamera& camera : model->cameras)
    (void)camera_model_from_colmap(camera.model, camera.parameters);
}

// Pieces that have a meaning in these formats.
using namespace std::string_literals;
const std::string kModelPieces[] = {" ",
                                    "\n",
                                    "-1",
                                    "nan",
                                    "inf",
                                    "1e999",
                                    "1e308",
                                    "99999999999",
                                    "18446744073709551615",
                                    "0x1",
                                    "#",
                                    "\n\n",
                                    "1 ",
                                    "\0"s,
                                    "\xff\xff\xff\xff"s,
                                    "\0\0\0\0\0\0\xf0\x7f"s,
                                    "\0\0\0\0"s,
                                    "PINHOLE",
                                    "4294967296"};

// What of it lies at the beginning is hit more often: counts and identifiers.
ColmapFiles small_model(bool binary) {
  Reconstruction reconstruction = testing_support::small_reconstruction({Pinhole{500, 510, 319.5, 239.5}});
  const testing_support::TemporaryFolder folder;
  EXPECT_TRUE(write_colmap_model(reconstruction, folder.path()));
  ColmapModel model = *read_colmap_model(folder.path());
  model.points.resize(10);
  model.images.resize(2);
  for (ColmapImage& image : model.images) {
    image.last_keypoint = std::min(image.last_keypoint, image.first_keypoint + 5);
    for (size_t k = image.first_keypoint; k < image.last_keypoint; ++k)
      model.keypoints[k].point_id = kNoColmapPoint;
  }
  for (ColmapPoint& point : model.points) point.last_element = point.first_element;
  for (size_t k = 0; k < 3; ++k) {  // a track through keypoint k of both images
    ColmapPoint& point = model.points[k];
    point.first_element = model.elements.size();
    for (int i = 0; i < 2; ++i) {
      model.keypoints[model.images[i].first_keypoint + k].point_id = point.id;
      model.elements.push_back({model.images[i].id, static_cast<uint32_t>(k), i});
    }
    point.last_element = model.elements.size();
  }
  model.binary = binary;
  return format_colmap(model);
}

TEST(ReconstructionFuzz, DamagedBalFiles) {
  const std::string text =
      "2 3 4\n0 0 -332.65 262.09\n1 0 1.5 -2\n0 1 .25 1e-3\n1 2 7 8\n1 2 3 4 5 6 7 8 9\n"
      "1e-2 -2 3.5 4 5 6 7 8 9\n1 2 3\n4 5 6\n7 8 9\n";
  expect_bal_or_line(text);
  Rng random(1);
  for (int i = 0; i < 20000; ++i) {
    const std::string broken = testing_support::damaged(text, kModelPieces, random);
    expect_bal_or_line(broken);
    ASSERT_FALSE(HasFatalFailure()) << broken;
  }
}

TEST(ReconstructionFuzz, DamagedColmapModels) {
  for (const bool binary : {true, false}) {
    const ColmapFiles whole = small_model(binary);
    ASSERT_TRUE(parse_colmap(whole, "folder"));
    Rng random(2);
    for (int i = 0; i < 10000; ++i) {
      ColmapFiles files = whole;
      std::string* const contents[] = {&files.cameras, &files.images, &files.points};
      std::string& content = *contents[random.index(3)];
      content = testing_support::damaged(content, kModelPieces, random);
      expect_model_or_line(files);
      ASSERT_FALSE(HasFatalFailure()) << content;
    }
  }
}

TEST(ReconstructionFuzz, RandomBytes) {
  Rng random(3);
  for (int i = 0; i < 3000; ++i) {
    ColmapFiles files{.binary = i % 2 == 0, .cameras = {}, .images = {}, .points = {}};
    for (std::string* content : {&files.cameras, &files.images, &files.points}) {
      content->resize(random.index(200));
      for (char& c : *content) c = static_cast<char>(random.index(i % 3 ? 256 : 3));
    }
    expect_model_or_line(files);
    expect_bal_or_line(files.images);
  }
}

}  // namespace
}  // namespace raysfm
