#include "raysfm/features/sharpness.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include <opencv2/imgproc.hpp>

#include "support/cv_header.h"
#include "support/soft_edges.h"
#include "support/texture.h"

namespace raysfm {
namespace {

using testing_support::header;
using testing_support::soft_board;
using testing_support::soft_stripes;

// Not wider: slopes of few grey levels a pixel are known badly.
TEST(EdgeWidth, OfStripesAtAnyAngle) {
  for (const double sigma : {0.8, 1.5, 3.0}) {
    EXPECT_NEAR(edge_width(soft_stripes(640, 480, 0, sigma)), sigma, 0.1 * sigma) << sigma;
    EXPECT_NEAR(edge_width(soft_stripes(640, 480, 90, sigma)), sigma, 0.1 * sigma) << sigma;
    // Rows cross a slanted edge along sigma / cos, columns along sigma / sin.
    for (const double degrees : {20.0, 45.0, 65.0}) {
      const double angle = degrees * std::numbers::pi / 180;
      const double expected = sigma / std::sqrt(std::cos(angle) * std::sin(angle));
      EXPECT_NEAR(edge_width(soft_stripes(640, 480, degrees, sigma)), expected, 0.1 * expected)
          << sigma << " at " << degrees;
    }
  }
}

TEST(EdgeWidth, GrowsWithAnEnlargementAndABlur) {
  constexpr double kSigma = 0.8;
  GrayImage sharp = soft_board(640, 480, kSigma);
  const double width = edge_width(sharp);
  EXPECT_NEAR(width, kSigma, 0.12 * kSigma);
  for (const int k : {2, 3, 4}) {
    GrayImage large(640 * k, 480 * k);
    cv::Mat target = header(large);
    cv::resize(header(sharp), target, target.size(), 0, 0, cv::INTER_CUBIC);
    EXPECT_NEAR(edge_width(large), k * kSigma, 0.1 * k * kSigma) << k;
  }
  for (const double s : {1.0, 2.0, 3.0}) {
    GrayImage blurred(640, 480);
    cv::Mat target = header(blurred);
    cv::GaussianBlur(header(sharp), target, {}, s);
    const double expected = std::hypot(width, s);
    EXPECT_NEAR(edge_width(blurred), expected, 0.1 * expected) << s;
  }
}

// A step that a motion by L pixels drew out rises by its height / L a pixel.
TEST(EdgeWidth, GrowsAlongAMotionAlone) {
  constexpr double kSigma = 0.7;
  GrayImage sharp = soft_board(960, 720, kSigma);
  for (const int length : {5, 9, 15}) {
    const float expected = 0.4f * static_cast<float>(length);
    GrayImage blurred(960, 720);
    cv::Mat target = header(blurred);
    cv::blur(header(sharp), target, {length, 1});
    const EdgeWidths across = edge_widths(blurred);
    EXPECT_NEAR(across.along_rows, expected, 0.15 * expected) << length;
    EXPECT_LT(across.along_columns, 1.3 * kSigma) << length;  // the board is turned a little
    EXPECT_EQ(across.wider(), across.along_rows);
    cv::blur(header(sharp), target, {1, length});
    const EdgeWidths down = edge_widths(blurred);
    EXPECT_NEAR(down.along_columns, expected, 0.15 * expected) << length;
    EXPECT_LT(down.along_rows, 1.3 * kSigma) << length;
    EXPECT_EQ(down.wider(), down.along_columns);
  }
}

TEST(EdgeWidth, HardlyDependsOnTheSizeOfTheImageOrItsNoise) {
  for (const double sigma : {0.8, 1.5, 2.5}) {
    for (const auto& [width, height] : {std::pair(240, 180), std::pair(1000, 500), std::pair(1920, 1080)}) {
      EXPECT_NEAR(edge_width(soft_board(width, height, sigma)), sigma, 0.12 * sigma) << width;
    }
    EXPECT_NEAR(edge_width(soft_board(640, 480, sigma, 2.0)), sigma, 0.2 * sigma) << "noise";
  }
}

TEST(EdgeWidth, IsZeroWithoutEdges) {
  EXPECT_EQ(edge_width(testing_support::render(
                testing_support::Texture(1, 300, 400, 5), 640, 480,
                [](const Eigen::Vector2d& p) { return p; }, 1, 0, 2.0, 3)),
            0);
  EXPECT_EQ(edge_width(soft_board(1, 1, 1)), 0);
  EXPECT_EQ(edge_width(soft_board(2, 1, 1)), 0);
  for (const auto& [width, height] : {std::pair(1, 20000), std::pair(20000, 1), std::pair(7, 9)}) {
    EXPECT_LT(edge_width(soft_board(width, height, 1)), 2) << width << " x " << height;
  }
}

}  // namespace
}  // namespace raysfm
