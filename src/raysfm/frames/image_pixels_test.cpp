// Decoders of JPEG and PNG against the values that were encoded, and against OpenCV's.
#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "raysfm/core/random.h"
#include "raysfm/frames/image_file.h"
#include "raysfm/frames/jpeg_pixels.h"
#include "raysfm/frames/png_chunks.h"
#include "raysfm/frames/png_pixels.h"
#include "support/encoded_images.h"
#include "support/image_files.h"
#include "support/shared_data.h"
#include "support/temporary_folder.h"

namespace raysfm {
namespace {

using namespace testing_support;

cv::Mat opencv(const std::string& file, int mode) {
  return cv::imdecode(cv::Mat(1, static_cast<int>(file.size()), CV_8U, const_cast<char*>(file.data())), mode);
}

// Smooth, with colours.
std::vector<uint8_t> soft_values(int width, int height, int channels) {
  std::vector<uint8_t> values;
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      for (int c = 0; c < channels; ++c) {
        values.push_back(
            static_cast<uint8_t>(128 + 90 * std::sin(0.11 * x + 2.1 * c) * std::cos(0.07 * y - c)));
      }
    }
  }
  return values;
}

void expect_colours(const DecodedImage& image, const cv::Mat& bgr, double mean_difference) {
  double sum = 0;
  for (int y = 0; y < bgr.rows; ++y) {
    for (int x = 0; x < bgr.cols; ++x) {
      const auto rgb = image.colors.at(x, y, image.gray.row(y)[x]);
      for (int c = 0; c < 3; ++c) sum += std::abs(rgb[c] - bgr.at<cv::Vec3b>(y, x)[2 - c]);
    }
  }
  EXPECT_LT(sum / (3.0 * bgr.rows * bgr.cols), mean_difference);
}

// Sizes about multiples of the blocks, all that sampling can be.
TEST(Jpeg, LumaIsThatOfOpenCvWhateverTheSampling) {
  for (const auto& [luma_h, luma_v] :
       {std::pair(1, 1), std::pair(2, 1), std::pair(2, 2), std::pair(1, 2), std::pair(4, 1)}) {
    for (const auto& [width, height] :
         {std::pair(64, 48), std::pair(65, 47), std::pair(1, 1), std::pair(130, 17)}) {
      for (const bool progressive : {false, true}) {
        const std::string file = jpeg_file({.width = width,
                                            .height = height,
                                            .values = soft_values(width, height, 3),
                                            .luma_h = luma_h,
                                            .luma_v = luma_v,
                                            .progressive = progressive});
        const Result<DecodedImage> image = decode_jpeg(file);
        ASSERT_TRUE(image) << image.error().message;
        EXPECT_TRUE(same_pixels(image->gray, opencv(file, cv::IMREAD_GRAYSCALE)))
            << luma_h << luma_v << " " << width << "x" << height;
        expect_colours(*image, opencv(file, cv::IMREAD_COLOR), luma_h * luma_v == 1 ? 1 : 6);
      }
    }
  }
}

TEST(Jpeg, GreyRgbAndCmykAreReadToo) {
  const int width = 40, height = 30;
  const std::string grey = jpeg_file({.width = width,
                                      .height = height,
                                      .given = JCS_GRAYSCALE,
                                      .stored = JCS_GRAYSCALE,
                                      .values = soft_values(width, height, 1),
                                      .luma_h = 2,
                                      .luma_v = 2});
  const Result<DecodedImage> image = decode_jpeg(grey);
  ASSERT_TRUE(image) << image.error().message;
  EXPECT_TRUE(image->colors.empty());
  EXPECT_TRUE(same_pixels(image->gray, opencv(grey, cv::IMREAD_GRAYSCALE)));
  for (const J_COLOR_SPACE space : {JCS_RGB, JCS_CMYK}) {
    const std::string file = jpeg_file({.width = width,
                                        .height = height,
                                        .given = space,
                                        .stored = space,
                                        .values = soft_values(width, height, space == JCS_RGB ? 3 : 4)});
    const Result<DecodedImage> colours = decode_jpeg(file);
    ASSERT_TRUE(colours) << colours.error().message;
    expect_colours(*colours, opencv(file, cv::IMREAD_COLOR), 2);
  }
}

TEST(Jpeg, RealImagesHaveOpenCvsLuma) {
  RAYSFM_SKIP_WITHOUT_SHARED_DATA("redkitchen-handheld/images");
  const auto path = shared_data("redkitchen-handheld/images/000123.jpg");
  const Result<DecodedImage> image = read_image(path);
  ASSERT_TRUE(image) << image.error().message;
  EXPECT_TRUE(same_pixels(image->gray, cv::imread(path.string(), cv::IMREAD_GRAYSCALE)));
  expect_colours(*image, cv::imread(path.string()), 2);
}

TEST(Jpeg, WhatTheDecoderOnlySuspectsIsToldFromDamage) {
  const std::string file = jpeg_file({.width = 64, .height = 48, .values = soft_values(64, 48, 3)});
  testing::internal::CaptureStderr();
  // Bytes between the scan and the mark at the end do no harm.
  std::string odd = file;
  odd.insert(odd.size() - 2, 20, '\x55');
  EXPECT_TRUE(decode_jpeg(odd));
  // The second half of the scan is gone.
  std::string short_scan = file;
  short_scan.erase(file.size() * 2 / 3, file.size() / 3 - 2);
  EXPECT_FALSE(decode_jpeg(short_scan));
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
}

TEST(Jpeg, SizesThatTheFileCannotHoldAreRefusedBeforeRoomIsMade) {
  std::string file = jpeg_file({.width = 64, .height = 48, .values = soft_values(64, 48, 3)});
  const size_t frame = file.find("\xff\xc0") + 5;  // height and width, two bytes each
  file.replace(frame, 4, std::string("\x40\0\x40\0", 4));
  Result<DecodedImage> image = decode_jpeg(file);
  ASSERT_FALSE(image);
  EXPECT_NE(image.error().message.find("damaged"), std::string::npos);
  file.replace(frame, 4, "\xff\x01\xff\x01");
  image = decode_jpeg(file);
  ASSERT_FALSE(image);
  EXPECT_NE(image.error().message.find("65281 x 65281 pixels; allowed"), std::string::npos);
}

// Every filter, type and depth; the chunks of pixels in pieces.
TEST(Png, ValuesAreThoseEncoded) {
  Rng random(3);
  const int width = 37, height = 23;
  const std::pair<int, int> types[] = {{0, 1}, {2, 3}, {4, 2}, {6, 4}};
  for (const auto& [type, channels] : types) {
    for (const int depth : {8, 16}) {
      PngRecipe recipe{.width = width, .height = height, .depth = depth, .color_type = type};
      recipe.bytes.resize(size_t(width) * height * channels * depth / 8);
      for (uint8_t& byte : recipe.bytes) byte = static_cast<uint8_t>(random.index(256));
      recipe.filters = {4, 3, 2, 1, 0, 4, 1, 3};
      recipe.idat_bytes = 300;
      const std::string file = png_file(recipe);
      ASSERT_TRUE(is_plain_png(*pixel_chunks_of_png(file)));
      const Result<DecodedImage> image = decode_png(*pixel_chunks_of_png(file));
      ASSERT_TRUE(image) << image.error().message;
      const auto value = [&](int x, int y, int c) {
        const size_t i = (size_t(y) * width + x) * channels + c;
        if (depth == 8) return double(recipe.bytes[i]);
        return (recipe.bytes[2 * i] * 256 + recipe.bytes[2 * i + 1]) / 257.0;
      };
      for (int y = 0; y < height; ++y) {
        for (int x = 0; x < width; ++x) {
          const uint8_t grey = image->gray.row(y)[x];
          if (channels < 3) {
            ASSERT_NEAR(grey, value(x, y, 0), 0.5) << type << " " << depth;
            continue;
          }
          const auto rgb = image->colors.at(x, y, grey);
          for (int c = 0; c < 3; ++c) ASSERT_NEAR(rgb[c], value(x, y, c), 0.5);
          ASSERT_NEAR(grey, 0.299 * rgb[0] + 0.587 * rgb[1] + 0.114 * rgb[2], 0.51);
        }
      }
      if (depth != 8 || channels == 2) continue;
      cv::Mat expected = opencv(file, cv::IMREAD_UNCHANGED);
      if (channels > 2)
        cv::cvtColor(expected, expected, channels == 3 ? cv::COLOR_BGR2GRAY : cv::COLOR_BGRA2GRAY);
      EXPECT_TRUE(same_pixels(image->gray, expected)) << type;
    }
  }
}

TEST(Png, PalettesAreReadToo) {
  const TemporaryFolder folder;
  PngRecipe recipe{.width = 4, .height = 2, .color_type = 3, .bytes = {0, 1, 0, 1, 1, 0, 1, 0}};
  recipe.palette = std::string("\x0a\x14\x1e\xc8\x64\x32", 6);
  const Result<DecodedImage> image = read_image(folder.file("palette.png", png_file(recipe)));
  ASSERT_TRUE(image) << image.error().message;
  EXPECT_EQ(image->colors.at(1, 0, 0), (std::array<uint8_t, 3>{200, 100, 50}));
  EXPECT_EQ(image->colors.at(1, 1, 0), (std::array<uint8_t, 3>{10, 20, 30}));
}

TEST(Png, SizesThatTheFileCannotHoldAreRefusedBeforeRoomIsMade) {
  PngRecipe recipe{.width = 2, .height = 2, .bytes = {1, 2, 3, 4}};
  const std::string file = png_file(recipe);
  const auto with_size = [&](uint32_t width, uint32_t height, int depth) {
    return file.substr(0, 8) +
           png_chunk("IHDR", big_endian_bytes(width) + big_endian_bytes(height) + static_cast<char>(depth) +
                                 std::string(4, '\0')) +
           file.substr(33);
  };
  const auto refused = [&](uint32_t width, uint32_t height, int depth) {
    const Result<DecodedImage> image = decode_png(with_size(width, height, depth));
    return image ? std::string("read") : image.error().message;
  };
  EXPECT_NE(refused(32768, 16384, 16).find("damaged"), std::string::npos);
  EXPECT_NE(refused(32769, 1, 8).find("32769 x 1 pixels"), std::string::npos);
  EXPECT_NE(refused(0, 2, 8).find("0 x 2 pixels"), std::string::npos);
  EXPECT_NE(refused(0xffffffff, 0xffffffff, 8).find("allowed"), std::string::npos);
  EXPECT_NE(refused(3, 2, 8).find("damaged"), std::string::npos);
  EXPECT_NE(refused(2, 1, 8).find("damaged"), std::string::npos);
  EXPECT_EQ(refused(2, 2, 8), "read");
}

}  // namespace
}  // namespace raysfm
