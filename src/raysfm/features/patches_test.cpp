#include "raysfm/features/patches.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <opencv2/imgproc.hpp>

#include "raysfm/image/pyramid.h"
#include "support/instruction_sets.h"
#include "support/texture.h"

namespace raysfm {
namespace {

using testing_support::for_each_instruction_set;
using testing_support::random_image;
using testing_support::render;
using testing_support::Texture;

GrayImage textured_image(uint64_t seed, int width = 160, int height = 120) {
  return render(Texture(seed, 5, 40, 35), width, height, [](const Eigen::Vector2d& p) { return p; });
}

cv::Mat window(const GrayImage& image, int x, int y) {
  const cv::Mat all(image.height(), image.width(), CV_8U, const_cast<uint8_t*>(image.row(0)),
                    image.view().stride);
  return all(cv::Rect(x - kPatchRadius, y - kPatchRadius, kPatchSide, kPatchSide));
}

double opencv_zncc(const cv::Mat& a, const cv::Mat& b) {
  cv::Mat score;
  cv::matchTemplate(a, b, score, cv::TM_CCOEFF_NORMED);
  return score.at<float>(0, 0);
}

TEST(Patches, CorrelationIsThatOfOpenCv) {
  const GrayImage smooth = textured_image(1), noise = random_image(160, 120, 2);
  std::vector<Eigen::Vector2f> pixels;
  for (int y = 10; y < 110; y += 9) {
    for (int x = 10; x < 150; x += 7) pixels.emplace_back(x, y);
  }
  PatchSet a, b;
  extract_patches(smooth.view(), pixels, &a);
  extract_patches(noise.view(), pixels, &b);
  double worst = 0;
  for (size_t i = 0; i < pixels.size(); ++i) {
    const size_t j = (i * 7 + 3) % pixels.size();
    const auto at = [&](const GrayImage& image, size_t k) {
      return window(image, static_cast<int>(pixels[k].x()), static_cast<int>(pixels[k].y()));
    };
    const int p = static_cast<int>(i), q = static_cast<int>(j);
    worst = std::max(worst, std::abs(zncc(a, p, a, q) - opencv_zncc(at(smooth, i), at(smooth, j))));
    worst = std::max(worst, std::abs(zncc(a, p, b, q) - opencv_zncc(at(smooth, i), at(noise, j))));
    worst = std::max(worst, std::abs(zncc(b, p, b, q) - opencv_zncc(at(noise, i), at(noise, j))));
    EXPECT_NEAR(zncc(a, p, a, p), 1, 1e-5);
  }
  EXPECT_LT(worst, 0.01);
}

TEST(Patches, GainAndBiasDoNotMatter) {
  const Texture texture(3, 5, 40, 35);
  const auto identity = [](const Eigen::Vector2d& p) { return p; };
  const GrayImage plain = render(texture, 64, 64, identity), dim = render(texture, 64, 64, identity, 0.5, 10);
  const std::vector<Eigen::Vector2f> pixels{{30, 30}, {20.25f, 40.5f}};
  PatchSet a, b;
  extract_patches(plain.view(), pixels, &a);
  extract_patches(dim.view(), pixels, &b);
  EXPECT_GT(zncc(a, 0, b, 0), 0.995f);
  EXPECT_GT(zncc(a, 1, b, 1), 0.995f);
}

TEST(Patches, FractionsOfAPixelAreSampled) {
  const Texture texture(4, 8, 40, 35);
  const Eigen::Vector2d shift(0.5, 0.25);
  const GrayImage image = render(texture, 64, 64, [](const Eigen::Vector2d& p) { return p; });
  const GrayImage shifted = render(texture, 64, 64, [&](const Eigen::Vector2d& p) { return p + shift; });
  PatchSet between, at;
  extract_patches(image.view(), std::vector<Eigen::Vector2f>{{30.5f, 30.25f}, {30, 30}}, &between);
  extract_patches(shifted.view(), std::vector<Eigen::Vector2f>{{30, 30}}, &at);
  EXPECT_GT(zncc(between, 0, at, 0), 0.999f);
  EXPECT_LT(zncc(between, 1, at, 0), 0.99f);
}

TEST(Patches, WithoutTextureOrOutsideNotValid) {
  GrayImage flat(64, 64);
  Rng rng(1);
  for (int y = 0; y < 64; ++y) {
    for (int x = 0; x < 64; ++x) flat.row(y)[x] = static_cast<uint8_t>(100 + rng.index(3));
  }
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const std::vector<Eigen::Vector2f> pixels{{30, 30}, {4, 30},   {30, 4},   {59, 30},
                                            {30, 59}, {nan, 30}, {1e30f, 3}};
  const std::vector<Eigen::Matrix2f> identity(pixels.size(), Eigen::Matrix2f::Identity());
  PatchSet a, b;
  extract_patches(flat.view(), pixels, &a);
  EXPECT_FALSE(a.valid(0));
  EXPECT_EQ(zncc(a, 0, a, 0), 0);
  const GrayImage noise = random_image(64, 64, 5);
  extract_patches(noise.view(), pixels, &a);
  extract_warped_patches(noise.view(), pixels, identity, &b);
  EXPECT_TRUE(a.valid(0) && b.valid(0));
  for (int i = 1; i < a.size(); ++i) EXPECT_FALSE(a.valid(i) || b.valid(i)) << i;
  const Eigen::Matrix2f bad = Eigen::Matrix2f::Constant(nan);
  extract_warped_patches(noise.view(), std::span(pixels).first(1), std::span(&bad, 1), &b);
  EXPECT_FALSE(b.valid(0));
}

TEST(Patches, AtTheRightBorderAsElsewhere) {
  const GrayImage wide = textured_image(6, 160, 64);
  // The same pixels as a narrow image whose memory ends with its last row.
  std::vector<uint8_t> narrow;
  for (int y = 0; y < 64; ++y) narrow.insert(narrow.end(), wide.row(y), wide.row(y) + 80);
  const GrayView view{narrow.data(), 80, 64, 80};
  std::vector<Eigen::Vector2f> pixels;
  for (float x = 60; x < 73; x += 0.5f) pixels.emplace_back(x, 56.75f);
  PatchSet a, b;
  extract_patches(wide.view(), pixels, &a);
  extract_patches(view, pixels, &b);
  for (int i = 0; i < a.size(); ++i) {
    ASSERT_TRUE(a.valid(i) && b.valid(i));
    EXPECT_EQ(std::memcmp(a.patch(i), b.patch(i), kPatchStride), 0);
  }
}

TEST(Patches, WarpsShowWhatTheOtherViewSees) {
  const Texture texture(7, 9, 40, 35);
  const Eigen::Vector2d centre(60, 50);
  Eigen::Matrix2d m;
  m << 1.2, -0.5, 0.4, 0.9;
  const GrayImage image = render(texture, 120, 100, [](const Eigen::Vector2d& p) { return p; });
  const GrayImage other = render(texture, 41, 41, [&](const Eigen::Vector2d& p) -> Eigen::Vector2d {
    return centre + m * (p - Eigen::Vector2d(20, 20));
  });
  const std::vector<Eigen::Vector2f> pixels{centre.cast<float>()};
  const std::vector<Eigen::Matrix2f> warp{m.cast<float>()};
  PatchSet warped, straight, seen;
  extract_warped_patches(image.view(), pixels, warp, &warped);
  extract_patches(image.view(), pixels, &straight);
  extract_patches(other.view(), std::vector<Eigen::Vector2f>{{20, 20}}, &seen);
  EXPECT_GT(zncc(warped, 0, seen, 0), 0.998f);
  EXPECT_LT(zncc(straight, 0, seen, 0), 0.95f);
}

// Fine texture seen from twice as far: without the pyramid, a sample every other pixel aliases.
TEST(Patches, MinificationReadsTheMatchingLevel) {
  const GrayImage image = random_image(200, 200, 8);
  std::vector<GrayImage> levels;
  make_pyramid(image.view(), 2, &levels);
  const std::vector<GrayView> views{image.view(), levels[0].view(), levels[1].view()};
  const std::vector<Eigen::Vector2f> pixels{{101, 81}};
  const std::vector<Eigen::Matrix2f> twice{2 * Eigen::Matrix2f::Identity()};
  PatchSet with, without, truth;
  extract_warped_patches(views, pixels, twice, &with);
  extract_warped_patches(image.view(), pixels, twice, &without);
  extract_patches(levels[0].view(), std::vector<Eigen::Vector2f>{{50.25f, 40.25f}}, &truth);
  EXPECT_GT(zncc(with, 0, truth, 0), 0.999f);
  EXPECT_LT(zncc(without, 0, truth, 0), 0.99f);
}

TEST(Patches, EveryInstructionSetGivesTheSameBytes) {
  const GrayImage image = textured_image(9);
  std::vector<Eigen::Vector2f> pixels;
  std::vector<Eigen::Matrix2f> warps;
  Rng rng(2);
  for (int i = 0; i < 200; ++i) {
    pixels.emplace_back(rng.uniform(15, 140), rng.uniform(15, 100));
    warps.emplace_back();
    warps.back() << rng.uniform(0.7, 1.4), rng.uniform(-0.3, 0.3), rng.uniform(-0.3, 0.3),
        rng.uniform(0.7, 1.4);
  }
  PatchSet straight, warped;
  extract_patches(image.view(), pixels, &straight);
  extract_warped_patches(image.view(), pixels, warps, &warped);
  for_each_instruction_set([&](const char* name) {
    PatchSet a, b;
    extract_patches(image.view(), pixels, &a);
    extract_warped_patches(image.view(), pixels, warps, &b);
    for (int i = 0; i < a.size(); ++i) {
      ASSERT_EQ(a.inverse_norm(i), straight.inverse_norm(i)) << name;
      ASSERT_EQ(b.inverse_norm(i), warped.inverse_norm(i)) << name;
      ASSERT_TRUE(a.valid(i) && b.valid(i));
      ASSERT_EQ(std::memcmp(a.patch(i), straight.patch(i), kPatchStride), 0) << name;
      ASSERT_EQ(std::memcmp(b.patch(i), warped.patch(i), kPatchStride), 0) << name;
    }
  });
}

}  // namespace
}  // namespace raysfm
