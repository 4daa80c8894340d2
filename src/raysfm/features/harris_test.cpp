#include "raysfm/features/harris.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "support/instruction_sets.h"
#include "support/texture.h"

namespace raysfm {
namespace {

using testing_support::for_each_instruction_set;
using testing_support::random_image;
using testing_support::render;
using testing_support::Texture;

cv::Mat as_mat(const GrayImage& image) {
  return cv::Mat(image.height(), image.width(), CV_8U, const_cast<uint8_t*>(image.row(0)),
                 image.view().stride);
}

GrayImage textured(int width, int height, uint64_t seed) {
  return render(Texture(seed, 5, 40, 35), width, height, [](const Eigen::Vector2d& p) { return p; });
}

// The response by OpenCV's filters in double precision.
cv::Mat opencv_response(const GrayImage& image, double k) {
  cv::Mat gx, gy;
  cv::Sobel(as_mat(image), gx, CV_64F, 1, 0, 3, 1.0 / 8);
  cv::Sobel(as_mat(image), gy, CV_64F, 0, 1, 3, 1.0 / 8);
  const cv::Mat kernel = (cv::Mat_<double>(1, 5) << 1, 4, 6, 4, 1) / 16;
  cv::Mat xx, xy, yy;
  cv::sepFilter2D(gx.mul(gx), xx, CV_64F, kernel, kernel);
  cv::sepFilter2D(gx.mul(gy), xy, CV_64F, kernel, kernel);
  cv::sepFilter2D(gy.mul(gy), yy, CV_64F, kernel, kernel);
  return xx.mul(yy) - xy.mul(xy) - k * (xx + yy).mul(xx + yy);
}

// Every greatest of its 5 x 5 at least `border` inside, in scan order.
std::vector<cv::Point> brute_force_maxima(const cv::Mat& response, int border, double least) {
  std::vector<cv::Point> maxima;
  for (int y = border; y < response.rows - border; ++y) {
    for (int x = border; x < response.cols - border; ++x) {
      const double centre = response.at<double>(y, x);
      double greatest;
      cv::minMaxLoc(response(cv::Rect(x - 2, y - 2, 5, 5)), nullptr, &greatest);
      if (centre >= least && centre == greatest) maxima.emplace_back(x, y);
    }
  }
  return maxima;
}

HarrisOptions all_corners() {
  HarrisOptions options;
  options.max_features = 1 << 20;
  return options;
}

// Rows are worked on two at a time: an odd number of them leaves one. Up to the least border there is.
TEST(Harris, FindsTheMaximaOfOpenCvsResponse) {
  HarrisOptions options = all_corners();
  options.border = 5;
  for (const int height : {150, 151}) {
    const GrayImage image = textured(213, height, 1);
    const cv::Mat response = opencv_response(image, 0.04);
    const auto expected = brute_force_maxima(response, options.border, 5.0);
    ASSERT_GT(expected.size(), 100u);
    for_each_instruction_set([&](const char* name) {
      Features found;
      HarrisDetector().detect(image.view(), options, &found);
      ASSERT_EQ(static_cast<size_t>(found.size()), expected.size()) << name;
      for (int i = 0; i < found.size(); ++i) {
        EXPECT_LE(std::abs(found.pixels[i].x() - static_cast<float>(expected[i].x)), 0.5f);
        EXPECT_LE(std::abs(found.pixels[i].y() - static_cast<float>(expected[i].y)), 0.5f);
        const double truth = response.at<double>(expected[i]);
        EXPECT_NEAR(found.scores[i], truth, 1e-4 * truth + 1e-3);
      }
    });
  }
}

TEST(Harris, EveryInstructionSetGivesTheSameBits) {
  const GrayImage image = textured(301, 200, 2);
  Features reference;
  HarrisDetector().detect(image.view(), {}, &reference);
  for_each_instruction_set([&](const char* name) {
    Features found;
    HarrisDetector().detect(image.view(), {}, &found);
    EXPECT_EQ(found.scores, reference.scores) << name;
    EXPECT_EQ(found.pixels, reference.pixels) << name;
  });
}

// A round spot is symmetric, so its place is known without a model of the detector.
TEST(Harris, RoundSpotsAreFoundToATenthOfAPixel) {
  constexpr int kColumns = 9, kRows = 7;
  std::vector<Eigen::Vector2d> spots;
  Rng rng(3);
  for (int i = 0; i < kColumns * kRows; ++i) {
    spots.emplace_back(20 * (i % kColumns + 1) + rng.uniform(-0.5, 0.5),
                       20 * (i / kColumns + 1) + rng.uniform(-0.5, 0.5));
  }
  GrayImage image(200, 160);
  for (int y = 0; y < 160; ++y) {
    for (int x = 0; x < 200; ++x) {
      double value = 60;
      for (const auto& spot : spots)
        value += 150 * std::exp(-0.5 * (spot - Eigen::Vector2d(x, y)).squaredNorm());
      image.row(y)[x] = testing_support::to_grey(value);
    }
  }
  Features found;
  HarrisDetector().detect(image.view(), {}, &found);
  ASSERT_EQ(found.size(), kColumns * kRows);
  for (const auto& spot : spots) {
    double nearest = 1e9;
    for (const auto& p : found.pixels) nearest = std::min(nearest, (p.cast<double>() - spot).norm());
    EXPECT_LT(nearest, 0.1);
  }
}

TEST(Harris, HonoursBorderCountAndOrder) {
  const GrayImage image = textured(320, 240, 3);
  HarrisOptions options;
  options.max_features = 100;
  options.border = 30;
  Features found;
  HarrisDetector().detect(image.view(), options, &found);
  EXPECT_EQ(found.size(), 100);
  for (int i = 0; i < found.size(); ++i) {
    EXPECT_GE(found.pixels[i].minCoeff(), 29.5f);
    EXPECT_LT(found.pixels[i].x(), 320 - 30);
    EXPECT_LT(found.pixels[i].y(), 240 - 30);
    const int before = std::max(i - 1, 0);
    EXPECT_GE(std::lround(found.pixels[i].y()) + 1, std::lround(found.pixels[before].y()));
  }
}

TEST(Harris, MaskHidesWhatItDoesNotShow) {
  const GrayImage image = textured(320, 240, 4);
  GrayImage mask(320, 240);
  for (int y = 0; y < 240; ++y) std::fill_n(mask.row(y), 320, uint8_t(y < 120 ? 255 : 0));
  HarrisOptions options = all_corners();
  Features everywhere, upper;
  HarrisDetector detector;
  detector.detect(image.view(), options, &everywhere);
  options.mask = mask.view();
  detector.detect(image.view(), options, &upper);
  std::vector<Eigen::Vector2f> expected;
  for (const auto& p : everywhere.pixels) {
    if (std::lround(p.y()) + 6 < 120) expected.push_back(p);
  }
  ASSERT_GT(expected.size(), 50u);
  EXPECT_EQ(upper.pixels, expected);
}

TEST(Harris, FaintPartsOfTheImageGetTheirShare) {
  const Texture texture(5, 5, 40, 35);
  GrayImage image = render(texture, 320, 240, [](const Eigen::Vector2d& p) { return p; });
  for (int y = 0; y < 240; ++y) {
    for (int x = 160; x < 320; ++x) image.row(y)[x] = static_cast<uint8_t>(128 + (image.row(y)[x] - 128) / 4);
  }
  const auto share_of_right_half = [&](float spread) {
    HarrisOptions options;
    options.max_features = 200;
    options.shares.least = spread;
    Features found;
    HarrisDetector().detect(image.view(), options, &found);
    const auto right = [](const Eigen::Vector2f& p) { return p.x() > 165; };
    return static_cast<double>(std::count_if(found.pixels.begin(), found.pixels.end(), right)) / found.size();
  };
  EXPECT_LT(share_of_right_half(0), 0.05);
  EXPECT_GT(share_of_right_half(0.4f), 0.1);
  EXPECT_GT(share_of_right_half(0.9f), 0.3);
}

TEST(Harris, AnySizeAndAnyReuse) {
  HarrisDetector detector;
  Features found;
  for (int size = 0; size < 40; ++size) {
    for (const auto& [w, h] : {std::pair{size, 40}, {40, size}, {size, size}}) {
      const GrayImage image = random_image(w, h, static_cast<uint64_t>(size));
      detector.detect(image.view(), {}, &found);
      for (const auto& p : found.pixels) {
        EXPECT_GE(p.minCoeff(), 7.5f);
        EXPECT_LE(p.x(), static_cast<float>(w) - 8.5f);
        EXPECT_LE(p.y(), static_cast<float>(h) - 8.5f);
      }
    }
  }
  const GrayImage large = textured(200, 100, 6);
  Features again;
  detector.detect(large.view(), {}, &found);
  detector.detect(random_image(64, 300, 1).view(), {}, &again);
  detector.detect(large.view(), {}, &again);
  EXPECT_EQ(found.pixels, again.pixels);
}

TEST(Harris, NothingInAFlatImageOrOnAnEdge) {
  GrayImage image(100, 100);
  Features found;
  for (int y = 0; y < 100; ++y) std::fill_n(image.row(y), 100, uint8_t{77});
  HarrisDetector().detect(image.view(), {}, &found);
  EXPECT_EQ(found.size(), 0);
  for (int y = 0; y < 100; ++y) std::fill_n(image.row(y), 50, uint8_t{200});
  HarrisDetector().detect(image.view(), {}, &found);
  EXPECT_EQ(found.size(), 0);
}

}  // namespace
}  // namespace raysfm
