#include "raysfm/image/pyramid.h"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/imgproc.hpp>

#include "raysfm/image/blur.h"
#include "support/instruction_sets.h"
#include "support/texture.h"

namespace raysfm {
namespace {

using testing_support::for_each_instruction_set;
using testing_support::random_image;

cv::Mat as_mat(GrayImage& image) {
  return cv::Mat(image.height(), image.width(), CV_8U, image.row(0), image.view().stride);
}

TEST(Pyramid, HalfSampleIsTheAreaMeanOfOpenCv) {
  for (const auto& [width, height] : {std::pair{640, 480}, {202, 64}, {34, 18}, {2, 2}, {66, 4}}) {
    GrayImage image = random_image(width, height, 1);
    cv::Mat expected;
    cv::resize(as_mat(image), expected, {width / 2, height / 2}, 0, 0, cv::INTER_AREA);
    for_each_instruction_set([&](const char* name) {
      GrayImage half;
      half_sample(image.view(), &half);
      ASSERT_EQ(half.width(), width / 2);
      ASSERT_EQ(half.height(), height / 2);
      EXPECT_EQ(cv::norm(as_mat(half), expected, cv::NORM_INF), 0) << name << ' ' << width;
    });
  }
}

TEST(Pyramid, OddSidesLoseTheirLastRowAndColumn) {
  GrayImage odd = random_image(101, 77, 2);
  GrayImage even(100, 76), a, b;
  for (int y = 0; y < 76; ++y) std::copy_n(odd.row(y), 100, even.row(y));
  half_sample(odd.view(), &a);
  half_sample(even.view(), &b);
  EXPECT_EQ(cv::norm(as_mat(a), as_mat(b), cv::NORM_INF), 0);
}

TEST(Pyramid, LevelsStopBeforeTheyBecomeTooSmall) {
  const GrayImage image = random_image(320, 100, 3);
  std::vector<GrayImage> pyramid;
  make_pyramid(image.view(), 8, &pyramid);
  ASSERT_EQ(pyramid.size(), 2u);  // 160 x 50, 80 x 25; 40 x 12 is below 16
  EXPECT_EQ(pyramid[1].width(), 80);
  EXPECT_EQ(pyramid[1].height(), 25);
  make_pyramid(image.view(), 0, &pyramid);
  EXPECT_TRUE(pyramid.empty());
}

TEST(Pyramid, ThumbnailIsTheMeanOfBlocks) {
  GrayImage image = random_image(640, 480, 4);
  GrayImage thumbnail;
  EXPECT_EQ(make_thumbnail(image.view(), 80, &thumbnail), 8);
  cv::Mat expected;
  cv::resize(as_mat(image), expected, {80, 60}, 0, 0, cv::INTER_AREA);
  // Each of the three halvings rounds.
  EXPECT_LE(cv::norm(as_mat(thumbnail), expected, cv::NORM_INF), 2);
  EXPECT_EQ(make_thumbnail(image.view(), 640, &thumbnail), 1);
  EXPECT_EQ(cv::norm(as_mat(thumbnail), as_mat(image), cv::NORM_INF), 0);
}

TEST(Blur, IsTheBinomialFilterOfOpenCv) {
  for (const auto& [width, height] : {std::pair{640, 48}, {65, 7}, {5, 1}, {1, 5}, {1, 1}}) {
    GrayImage image = random_image(width, height, 5);
    const cv::Mat kernel = (cv::Mat_<float>(1, 3) << 0.25f, 0.5f, 0.25f);
    cv::Mat sums;
    cv::sepFilter2D(as_mat(image), sums, CV_32F, kernel, kernel, {-1, -1}, 0, cv::BORDER_REPLICATE);
    for_each_instruction_set([&](const char* name) {
      GrayImage blurred;
      blur3(image.view(), kBinomial, &blurred);
      for (int y = 0; y < height; ++y) {
        for (int x = 0; x < width; ++x) {
          ASSERT_EQ(blurred.row(y)[x], std::floor(sums.at<float>(y, x) + 0.5f))
              << name << ' ' << x << ' ' << y;
        }
      }
    });
  }
}

// Narrower ones, to the rounding of the two directions one after the other.
TEST(Blur, IsNarrowerWithASmallerSide) {
  for (const auto& [width, height] : {std::pair{640, 48}, {65, 7}, {5, 1}, {1, 5}}) {
    GrayImage image = random_image(width, height, 6);
    for (const int side : {0, 1, 20, 63}) {
      const float s = static_cast<float>(side) / 256;
      const cv::Mat kernel = (cv::Mat_<float>(1, 3) << s, 1 - 2 * s, s);
      cv::Mat expected;
      cv::sepFilter2D(as_mat(image), expected, CV_32F, kernel, kernel, {-1, -1}, 0, cv::BORDER_REPLICATE);
      for_each_instruction_set([&](const char* name) {
        GrayImage blurred;
        blur3(image.view(), side, &blurred);
        for (int y = 0; y < height; ++y) {
          for (int x = 0; x < width; ++x) {
            ASSERT_NEAR(blurred.row(y)[x], expected.at<float>(y, x), 0.55)
                << name << ' ' << side << ' ' << x << ' ' << y;
          }
        }
      });
    }
  }
}

TEST(Blur, EmptyImage) {
  GrayImage blurred;
  blur3(GrayView{}, kBinomial, &blurred);
  EXPECT_TRUE(blurred.empty());
}

}  // namespace
}  // namespace raysfm
