#include "raysfm/features/octaves.h"

#include <gtest/gtest.h>

#include <opencv2/imgproc.hpp>

#include "raysfm/image/noise.h"
#include "raysfm/image/pyramid.h"
#include "support/cv_header.h"
#include "support/soft_edges.h"
#include "support/texture.h"

namespace raysfm {
namespace {

using testing_support::header;
using testing_support::random_image;
using testing_support::soft_board;

constexpr int kAnySize = 1 << 30;

// Dim, with so much noise; grey levels.
GrayImage noisy_board(double noise) {
  GrayImage image = soft_board(640, 480, 0.6);
  Rng rng(5);
  for (int y = 0; y < image.height(); ++y) {
    for (int x = 0; x < image.width(); ++x) {
      image.row(y)[x] = testing_support::to_grey(40 + 0.2 * image.row(y)[x] + noise * rng.normal());
    }
  }
  return image;
}

TEST(Octaves, PlacesGoIntoAnOctaveAndBack) {
  const Eigen::Vector2f pixel(17.25f, 310.5f);
  for (int o = 0; o < 5; ++o) {
    EXPECT_LT((out_of_octave(into_octave(pixel, o), o) - pixel).norm(), 1e-4f);
  }
  // The corner of the image is the corner of every octave.
  EXPECT_EQ(into_octave({-0.5f, -0.5f}, 3), Eigen::Vector2f(-0.5f, -0.5f));
  EXPECT_EQ(out_of_octave({0, 0}, 1), Eigen::Vector2f(0.5f, 0.5f));
}

TEST(Octaves, EachIsTheHalfOfTheOneBefore) {
  const GrayImage image = soft_board(403, 391, 0.6);
  GrayImage copy(403, 391), half;
  cv::Mat target = header(copy);
  cv::Mat(391, 403, CV_8UC1, const_cast<uint8_t*>(image.row(0)), image.view().stride).copyTo(target);
  const Octaves octaves(std::move(copy), kAnySize);
  ASSERT_EQ(octaves.first(), 0);
  ASSERT_EQ(octaves.last(), 3);
  half_sample(image, &half);
  for (int o = 1; o <= 3; ++o) {
    const GrayView view = octaves.at(o);
    ASSERT_EQ(view.width, half.width());
    ASSERT_EQ(view.height, half.height());
    for (int y = 0; y < view.height; ++y)
      EXPECT_TRUE(std::equal(view.row(y), view.row(y) + view.width, half.row(y)));
    GrayImage next;
    half_sample(half, &next);
    half = std::move(next);
  }
  EXPECT_EQ(octaves.clamp(-1), 0);
  EXPECT_EQ(octaves.clamp(9), 3);
  EXPECT_EQ(octaves.views().size(), 4u);
}

// The edges are 0.6 pixels wide; an octave is too fine where they are wider than 1.5 of its pixels.
TEST(Octaves, LeaveOutWhatAnEnlargementMade) {
  GrayImage sharp = soft_board(640, 480, 0.6);
  for (const auto& [k, first] : {std::pair(1, 0), {2, 0}, {3, 1}, {4, 1}, {6, 2}, {8, 2}}) {
    GrayImage large(640 * k, 480 * k);
    cv::Mat target = header(large);
    cv::resize(header(sharp), target, target.size(), 0, 0, cv::INTER_CUBIC);
    EXPECT_EQ(Octaves(std::move(large), kAnySize).first(), first) << k;
  }
}

TEST(Octaves, LeaveOutWhatABlurTook) {
  for (const auto& [sigma, first] : {std::pair(0.7, 0), {1.2, 0}, {2.2, 1}, {4.0, 2}}) {
    EXPECT_EQ(Octaves(soft_board(1280, 960, sigma), kAnySize).first(), first) << sigma;
  }
}

// A long streak is not sharp along itself, however sharp it is across, and though noise breaks it in the
// octave where it is longest.
TEST(Octaves, LeaveOutWhatAMotionDrewOut) {
  GrayImage sharp = soft_board(1280, 960, 0.6);
  for (const auto& [length, first] : {std::pair(3, 0), {6, 0}, {12, 1}, {16, 1}, {20, 1}}) {
    for (const cv::Size motion : {cv::Size(length, 1), cv::Size(1, length)}) {
      GrayImage blurred(1280, 960);
      cv::Mat target = header(blurred);
      cv::blur(header(sharp), target, motion);
      Rng rng(5);
      for (int y = 0; y < blurred.height(); ++y) {
        for (int x = 0; x < blurred.width(); ++x)
          blurred.row(y)[x] = testing_support::to_grey(blurred.row(y)[x] + 3 * rng.normal());
      }
      const Octaves octaves(std::move(blurred), kAnySize);
      EXPECT_EQ(octaves.first(), first) << motion;
      EXPECT_NEAR(octaves.motion_blur(), 0.4 * length, 0.15 * 0.4 * length + 0.2) << motion;
    }
  }
}

// One pixel of blur, whatever the noise; less noise is left as it is.
TEST(Octaves, AreThoseOfABlurredImageWhereItIsNoisy) {
  for (const auto& [noise, blurred] : {std::pair(0.5, false), {6.0, true}, {12.0, true}}) {
    GrayImage image = noisy_board(noise), expected(image.width(), image.height());
    const cv::Mat before = header(image).clone();
    if (blurred) {
      cv::GaussianBlur(before, header(expected), {5, 5}, 1.0, 1.0, cv::BORDER_REPLICATE);
    } else {
      before.copyTo(header(expected));
    }
    const Octaves octaves(std::move(image), kAnySize);
    ASSERT_EQ(octaves.first(), 0);
    const GrayView view = octaves.at(0);
    const cv::Mat found(view.height, view.width, CV_8UC1, const_cast<uint8_t*>(view.row(0)), view.stride);
    EXPECT_LE(cv::norm(found, header(expected), cv::NORM_L1) / static_cast<double>(found.total()),
              blurred ? 1 : 0)
        << noise;
  }
}

// Where the finest are left out for their size, the noise is told, and taken, in the first that is used.
TEST(Octaves, NoiseIsThatOfTheFirst) {
  GrayImage half;
  half_sample(noisy_board(12), &half);
  const cv::Mat before = header(half).clone();
  subdue_noise(&half);
  const Octaves octaves(noisy_board(12), 320 * 240);
  ASSERT_EQ(octaves.first(), 1);
  const GrayView view = octaves.at(1);
  const cv::Mat found(view.height, view.width, CV_8UC1, const_cast<uint8_t*>(view.row(0)), view.stride);
  EXPECT_EQ(cv::norm(found, header(half), cv::NORM_INF), 0);
  EXPECT_GT(cv::norm(found, before, cv::NORM_INF), 0);
}

TEST(Octaves, HaveNoMorePixelsThanWanted) {
  for (const auto& [pixels, first] : {std::pair(3'000'000, 0), {2'999'999, 1}, {750'000, 1}, {200'000, 2}}) {
    const Octaves octaves(random_image(2000, 1500, 2), pixels);
    EXPECT_EQ(octaves.first(), first);
    EXPECT_EQ(octaves.at(first).width, 2000 >> first);
  }
}

TEST(Octaves, OfAnySizeTakeAThirdMoreThanTheImage) {
  for (const auto& [width, height] :
       {std::pair(1, 1), {1, 9000}, {20, 20000}, {20000, 20}, {47, 95}, {95, 96}, {96, 96}, {97, 4001}}) {
    for (const int max_pixels : {1, 1 << 12, kAnySize}) {
      const Octaves octaves(random_image(width, height, 3), max_pixels);
      int64_t pixels = 0;
      for (const GrayView& view : octaves.views()) pixels += int64_t{view.width} * view.height;
      ASSERT_FALSE(octaves.at(octaves.first()).empty()) << width << " x " << height;
      EXPECT_LE(3 * pixels, 4 * int64_t{width} * height);
      const GrayView coarsest = octaves.at(octaves.last());
      EXPECT_EQ(coarsest.width, width >> octaves.last());
      if (octaves.last() > 0) {
        EXPECT_GE(std::min(coarsest.width, coarsest.height), 48);
      }
    }
  }
}

}  // namespace
}  // namespace raysfm
