// Random damage to image files: whatever comes in, an image that holds together or one line comes out, and
// nothing on stderr.
#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>

#include "raysfm/core/random.h"
#include "raysfm/frames/image_file.h"
#include "support/damage.h"
#include "support/encoded_images.h"
#include "support/temporary_folder.h"

namespace raysfm {
namespace {

using namespace testing_support;
using namespace std::string_literals;

void expect_image_or_line(const std::filesystem::path& path) {
  const Result<DecodedImage> image = read_image(path);
  if (!image) {
    ASSERT_TRUE(std::ranges::none_of(image.error().message, [](char c) { return c == '\n' || c == '\0'; }));
    return;
  }
  const GrayImage& gray = image->gray;
  const ColorPlanes& colors = image->colors;
  ASSERT_FALSE(gray.empty());
  int sum = 0;  // every pixel is there to be read
  for (int y = 0; y < gray.height(); ++y) {
    for (int x = 0; x < gray.width(); ++x) sum += colors.at(x, y, gray.row(y)[x])[1];
  }
  ASSERT_GE(sum, 0);
}

std::vector<uint8_t> noise(size_t count, Rng& random) {
  std::vector<uint8_t> values(count);
  for (uint8_t& value : values) value = static_cast<uint8_t>(random.index(256));
  return values;
}

// Pieces that have a meaning in these formats.
const std::string kPieces[] = {"\xff\xd8"s, "\xff\xd9"s, "\xff\xda"s, "\xff\xc0"s,
                               "\xff\xc2"s, "\xff\xc4"s, "\xff\xdb"s, "\xff\xdd\0\4\0\1"s,
                               "\xff\xd0"s, "\0\0"s,     "\xff\xff"s, "\x11"s,
                               "\x22"s,     "IDAT"s,     "IEND"s,     "\x7f\xff"s};

void damage_and_read(const std::vector<std::string>& files, int trials, uint64_t seed) {
  const TemporaryFolder folder;
  const std::filesystem::path path = folder.path() / "fuzz";
  Rng random(seed);
  testing::internal::CaptureStderr();
  for (int i = 0; i < trials; ++i) {
    const std::string broken = damaged(files[i % files.size()], kPieces, random);
    std::ofstream(path, std::ios::binary) << broken;
    expect_image_or_line(path);
    if (testing::Test::HasFatalFailure()) break;
  }
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
}

TEST(ImageFuzz, DamagedJpeg) {
  Rng random(1);
  std::vector<std::string> files;
  for (const int luma : {1, 2}) {
    for (const bool progressive : {false, true}) {
      files.push_back(jpeg_file({.width = 50,
                                 .height = 34,
                                 .values = noise(50 * 34 * 3, random),
                                 .luma_h = luma,
                                 .luma_v = luma,
                                 .progressive = progressive,
                                 .quality = 40}));
    }
  }
  files.push_back(jpeg_file({.width = 20,
                             .height = 30,
                             .given = JCS_CMYK,
                             .stored = JCS_CMYK,
                             .values = noise(20 * 30 * 4, random),
                             .quality = 30}));
  files.push_back(jpeg_file({.width = 20,
                             .height = 30,
                             .given = JCS_GRAYSCALE,
                             .stored = JCS_GRAYSCALE,
                             .values = noise(20 * 30, random)}));
  damage_and_read(files, 2000, 2);
}

TEST(ImageFuzz, DamagedPng) {
  Rng random(3);
  std::vector<std::string> files;
  for (const auto& [type, bytes] : {std::pair(0, 1), std::pair(2, 3), std::pair(4, 2), std::pair(6, 4)}) {
    files.push_back(png_file({.width = 17,
                              .height = 9,
                              .color_type = type,
                              .bytes = noise(17 * 9 * bytes, random),
                              .filters = {4, 3, 1, 2, 0}}));
  }
  damage_and_read(files, 1000, 4);
}

// Checksums are right, what they cover is not.
TEST(ImageFuzz, PngOfDamagedRows) {
  const TemporaryFolder folder;
  const std::filesystem::path path = folder.path() / "fuzz.png";
  static Rng random(5);
  for (int i = 0; i < 1000; ++i) {
    PngRecipe recipe{.width = 9, .height = 7, .color_type = i % 2 ? 2 : 0, .filters = {4, 3, 7, 1}};
    recipe.bytes = noise(9 * 7 * 3, random);
    recipe.damage = [](std::string* rows) { *rows = damaged(*rows, kPieces, random); };
    std::ofstream(path, std::ios::binary) << png_file(recipe);
    expect_image_or_line(path);
    ASSERT_FALSE(HasFatalFailure());
  }
}

}  // namespace
}  // namespace raysfm
