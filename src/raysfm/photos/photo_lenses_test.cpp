#include "raysfm/photos/photo_lenses.h"

#include <gtest/gtest.h>

#include <cmath>

namespace raysfm {
namespace {

PhotoExif phone() {
  return {.camera = "Acme", .lens = "Wide", .focal_mm = 4, .focal_35mm = 26, .width = 4000, .height = 3000};
}

std::vector<ExifLens> lenses_of(const std::vector<std::optional<PhotoExif>>& exif) {
  std::vector<TakenPhoto> photos;
  for (const auto& one : exif) {
    photos.push_back({std::to_string(photos.size()) + ".jpg", Eigen::Vector2i(4000, 3000), one});
  }
  photos.push_back({"damaged.jpg", Eigen::Vector2i(0, 0), {}});
  return lenses_by_exif(photos);
}

TEST(PhotoLenses, OneOfAllPhotosIsUsed) {
  auto lenses = lenses_of({phone(), phone(), phone()});
  ASSERT_EQ(lenses.size(), 1u);
  EXPECT_EQ(lenses[0].photos, 3);
  EXPECT_EQ(lenses[0].first_photo, "0.jpg");
  EXPECT_EQ(lenses[0].not_used, "");
  EXPECT_NEAR(lenses[0].focal_px, 26 * 5000 / std::hypot(36, 24), 1e-9);
  EXPECT_GT(lenses[0].focal_sigma_px, 0.02 * lenses[0].focal_px);
  EXPECT_EQ(lens_to_use(&lenses), &lenses[0]);
  EXPECT_TRUE(lenses_of({{}, {}}).empty());
}

TEST(PhotoLenses, SeveralAndCroppedOnesAreNamed) {
  PhotoExif zoomed = phone(), cropped = phone();
  zoomed.focal_mm = 8, zoomed.focal_35mm = 52;
  cropped.width = 8000;
  auto lenses = lenses_of({phone(), zoomed, phone()});
  ASSERT_EQ(lenses.size(), 2u);
  EXPECT_EQ(lenses[0].photos, 2);
  EXPECT_EQ(lenses[1].photos, 1);
  EXPECT_EQ(lenses[1].not_used, "one of 2 lenses of these photos");
  EXPECT_EQ(lens_to_use(&lenses), nullptr);
  lenses = lenses_of({phone(), cropped});
  ASSERT_EQ(lenses.size(), 2u);
  EXPECT_NE(lenses[0].not_used, "");
  EXPECT_EQ(lenses[1].not_used,
            "is of a photo of 8000x3000 pixels, this one has 4000x3000: cropped or resized");
  lenses = lenses_of({phone(), {}});
  EXPECT_EQ(lenses[0].not_used, "other photos do not say how they were taken");
}

TEST(PhotoLenses, PhotosOfOneLensHaveOneNumber) {
  PhotoExif zoomed = phone();
  zoomed.focal_mm = 8, zoomed.focal_35mm = 52;
  const auto numbers = [](const std::vector<std::optional<PhotoExif>>& exif) {
    std::vector<TakenPhoto> photos;
    for (const auto& one : exif) photos.push_back({"", Eigen::Vector2i(4000, 3000), one});
    photos.push_back({"damaged.jpg", Eigen::Vector2i(0, 0), {}});
    return numbers_of_lenses(photos);
  };
  EXPECT_EQ(numbers({phone(), zoomed, phone()}), (std::vector{0, 1, 0, -1}));
  EXPECT_TRUE(numbers({phone(), phone()}).empty());  // one lens for all is told otherwise
  EXPECT_TRUE(numbers({phone(), zoomed}).empty());   // nothing is shared
  EXPECT_TRUE(numbers({phone(), zoomed, phone(), {}}).empty());
}

TEST(PhotoLenses, WhatThePhotosContradictIsNamed) {
  const ExifLens said{.focal_px = 3000, .focal_sigma_px = 100};
  EXPECT_EQ(contradiction(said, 3290), "");
  EXPECT_EQ(contradiction(said, 2690), "contradicted by the photos, which say 2690.0 px");
}

}  // namespace
}  // namespace raysfm
