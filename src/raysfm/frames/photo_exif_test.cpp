#include "raysfm/frames/photo_exif.h"

#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "support/exif_bytes.h"
#include "support/temporary_folder.h"

namespace raysfm {
namespace {

using testing_support::exif_bytes;
using testing_support::ExifText;
using testing_support::jpeg_with_exif;
using testing_support::png_with_exif;

ExifText phone() {
  return {.maker = "Acme",
          .model = "Snap 7",
          .lens = "Wide",
          .focal_mm = 4.25,
          .focal_35mm = 26,
          .pixels_per_inch = 0,
          .width = 4000,
          .height = 3000};
}

TEST(PhotoExif, IsReadFromJpegAndPngInBothByteOrders) {
  const testing_support::TemporaryFolder folder;
  for (const bool big_endian : {false, true}) {
    for (const bool png : {false, true}) {
      const std::string bytes = exif_bytes(phone(), big_endian);
      const auto path = folder.file("photo", png ? png_with_exif(bytes) : jpeg_with_exif(bytes));
      const auto exif = read_exif(path);
      ASSERT_TRUE(exif) << big_endian << png;
      EXPECT_EQ(exif->camera, "Acme Snap 7");
      EXPECT_EQ(exif->lens, "Wide");
      EXPECT_DOUBLE_EQ(exif->focal_mm, 4.25);
      EXPECT_DOUBLE_EQ(exif->focal_35mm, 26);
      EXPECT_DOUBLE_EQ(exif->pixels_per_mm, 0);
      EXPECT_EQ(exif->width, 4000);
      EXPECT_EQ(exif->height, 3000);
    }
  }
}

TEST(PhotoExif, WhatIsCutShortOrNoneSaysNothing) {
  const testing_support::TemporaryFolder folder;
  for (const bool png : {false, true}) {
    const std::string bytes = exif_bytes(phone(), true);
    const std::string whole = png ? png_with_exif(bytes) : jpeg_with_exif(bytes);
    for (size_t size = 0; size < whole.size(); size += 7)
      read_exif(folder.file("cut", whole.substr(0, size)));
    for (size_t at = 0; at < whole.size(); ++at) {  // no crash, whatever a byte says
      std::string wrong = whole;
      wrong[at] = static_cast<char>(0xff);
      read_exif(folder.file("wrong", wrong));
    }
  }
  EXPECT_FALSE(read_exif(folder.file("none", jpeg_with_exif(""))));
  EXPECT_FALSE(read_exif(folder.file("other", "text")));
  EXPECT_FALSE(read_exif(folder.path() / "missing"));
}

// A film of 36 x 24 mm has a diagonal of 43.27 mm; a photo of 4000 x 3000 pixels one of 5000.
TEST(PhotoExif, FocalLengthByFilmAndBySensor) {
  PhotoExif exif{.focal_mm = 4.25, .focal_35mm = 26, .width = 4000, .height = 3000};
  EXPECT_NEAR(focal_of_exif(exif, 4000, 3000).px, 26 * 5000 / std::sqrt(36.0 * 36 + 24 * 24), 1e-9);
  EXPECT_NEAR(focal_of_exif(exif, 3000, 4000).px, 3004.6, 0.1);  // turned upright
  exif.pixels_per_mm = 4000 / 5.6;                               // a sensor 5.6 mm wide
  const ExifFocal focal = focal_of_exif(exif, 4000, 3000);
  EXPECT_NEAR(focal.px, 4.25 / 5.6 * 4000, 1e-9);
  EXPECT_NE(focal.source.find("4.25 mm on a sensor"), std::string::npos);
  EXPECT_EQ(focal.defect, "");
}

TEST(PhotoExif, WhatCannotBeIsNamedAndNotUsed) {
  const auto defect = [](const PhotoExif& exif, int width, int height) {
    const ExifFocal focal = focal_of_exif(exif, width, height);
    EXPECT_EQ(focal.px, 0);
    return focal.defect;
  };
  const PhotoExif exif{.focal_mm = 4.25, .focal_35mm = 26, .width = 4000, .height = 3000};
  EXPECT_EQ(defect(exif, 800, 600),
            "is of a photo of 4000x3000 pixels, this one has 800x600: cropped or resized");
  PhotoExif no_size = exif;
  no_size.width = 0;
  EXPECT_NE(defect(no_size, 4000, 3000).find("does not say of how many pixels"), std::string::npos);
  PhotoExif other = exif;
  other.pixels_per_mm = 100;
  EXPECT_NE(defect(other, 4000, 3000).find("contradicts itself: 3005 px by the form of 35 mm, 425 px"),
            std::string::npos);
  PhotoExif silly = exif;
  silly.focal_35mm = 65535;
  EXPECT_NE(defect(silly, 4000, 3000).find("which no lens of a photo"), std::string::npos);
  EXPECT_EQ(defect({.camera = "Acme", .width = 4000, .height = 3000}, 4000, 3000), "");
}

// A sensor's resolution may be told per inch, the default.
TEST(PhotoExif, ResolutionOfTheSensorPerInch) {
  const testing_support::TemporaryFolder folder;
  ExifText text = phone();
  text.pixels_per_inch = 25400;
  const auto exif = read_exif(folder.file("photo", jpeg_with_exif(exif_bytes(text, true))));
  ASSERT_TRUE(exif);
  EXPECT_DOUBLE_EQ(exif->pixels_per_mm, 1000);
}

}  // namespace
}  // namespace raysfm
