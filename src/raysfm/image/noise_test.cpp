#include "raysfm/image/noise.h"

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <cmath>
#include <numbers>

#include "support/texture.h"

namespace raysfm {
namespace {

using testing_support::render;
using testing_support::Texture;

// A picture of some contrast and mean, without noise.
GrayImage smooth_picture(double contrast, double mean = 128, int width = 480, int height = 360) {
  const Texture texture(3, 12, 200, contrast);
  return render(
      texture, width, height, [](const Eigen::Vector2d& p) -> Eigen::Vector2d { return p; }, 1, mean - 128);
}

// The same with white noise; grey levels.
GrayImage noisy(const GrayImage& clean, double noise, uint64_t seed = 0) {
  GrayImage image(clean.width(), clean.height());
  Rng rng(seed, 80);
  for (int y = 0; y < image.height(); ++y) {
    for (int x = 0; x < image.width(); ++x) {
      image.row(y)[x] = testing_support::to_grey(clean.row(y)[x] + noise * rng.normal());
    }
  }
  return image;
}

TEST(Noise, IsToldBesideTheContrast) {
  for (const double contrast : {12.0, 40.0}) {
    const GrayImage clean = smooth_picture(contrast);
    for (const double noise : {2.0, 5.0}) {
      const Grain grain = grain_of(noisy(clean, noise).view());
      EXPECT_NEAR(grain.noise, noise, 0.15 * noise) << contrast;
      // The upper quintile of blocks of 16 pixels is near the contrast of the texture.
      EXPECT_GT(grain.contrast, 0.6 * std::hypot(contrast, noise)) << noise;
      EXPECT_LT(grain.contrast, 1.5 * std::hypot(contrast, noise)) << noise;
      EXPECT_NEAR(grain.mean, 128, 0.5 * contrast) << noise;
    }
    EXPECT_LT(grain_of(noisy(clean, 0.3).view()).noise, 0.06 * contrast);
  }
}

// Half of the image without a picture, as about a fisheye's, is no picture without noise.
TEST(Noise, BordersSayNothing) {
  GrayImage image = noisy(smooth_picture(20), 6);
  const Grain whole = grain_of(image.view());
  for (int y = 0; y < image.height(); ++y) std::fill_n(image.row(y), image.width() * 2 / 5, uint8_t{0});
  const Grain half = grain_of(image.view());
  EXPECT_NEAR(half.noise, whole.noise, 0.1 * whole.noise);
  EXPECT_NEAR(half.contrast, whole.contrast, 0.2 * whole.contrast);
}

TEST(Noise, WhereNothingTellsItThereIsNone) {
  EXPECT_EQ(grain_of(GrayImage(0, 0).view()).contrast, 0);
  EXPECT_EQ(grain_of(noisy(smooth_picture(20, 128, 17, 400), 6).view()).contrast, 0);
  GrayImage flat(640, 480);
  for (int y = 0; y < 480; ++y) std::fill_n(flat.row(y), 640, uint8_t{90});
  EXPECT_EQ(grain_of(flat.view()).contrast, 0);
  EXPECT_GT(grain_of(noisy(smooth_picture(20, 128, 18, 18), 6).view()).noise, 0);
}

GrayImage subdued(GrayImage image) {
  subdue_noise(&image);
  return image;
}

// ZNCC over whole images, but for a border.
double likeness(const GrayImage& a, const GrayImage& b) {
  double sa = 0, sb = 0, saa = 0, sbb = 0, sab = 0, n = 0;
  for (int y = 4; y < a.height() - 4; ++y) {
    for (int x = 4; x < a.width() - 4; ++x, ++n) {
      const double p = a.row(y)[x], q = b.row(y)[x];
      sa += p, sb += q, saa += p * p, sbb += q * q, sab += p * q;
    }
  }
  return (sab - sa * sb / n) / std::sqrt((saa - sa * sa / n) * (sbb - sb * sb / n));
}

bool same(const GrayImage& a, const GrayImage& b) {
  for (int y = 0; y < a.height(); ++y) {
    if (!std::equal(a.row(y), a.row(y) + a.width(), b.row(y))) return false;
  }
  return true;
}

TEST(Noise, WhereThereIsLittleTheImageStaysAsItIs) {
  for (const double contrast : {20.0, 40.0}) {
    const GrayImage clean = smooth_picture(contrast);
    for (const double noise : {0.5, 0.05 * contrast}) {
      EXPECT_TRUE(same(subdued(noisy(clean, noise)), noisy(clean, noise))) << contrast << " " << noise;
    }
  }
  EXPECT_TRUE(subdued(GrayImage(0, 0)).empty());
}

// Two shots of one place in little light are alike once they are blurred: the noise of each is its own.
TEST(Noise, ShotsOfOnePlaceAreAlikeWithoutIt) {
  const GrayImage dim = smooth_picture(5, 40);
  EXPECT_LT(likeness(noisy(dim, 5, 1), noisy(dim, 5, 2)), 0.6);
  EXPECT_GT(likeness(subdued(noisy(dim, 5, 1)), subdued(noisy(dim, 5, 2))), 0.9);
}

// What remains of the pixels of blocks of 8 x 8 when their cosine transform is rounded to whole steps, as
// encoders do: fine noise goes, coarse noise stays. Two thirds of a step are none.
GrayImage coded(const GrayImage& image, double step) {
  using Block = Eigen::Matrix<double, 8, 8>;
  Block cosine;
  for (int k = 0; k < 8; ++k) {
    for (int x = 0; x < 8; ++x) {
      cosine(k, x) = std::sqrt(k == 0 ? 0.125 : 0.25) * std::cos((2 * x + 1) * k * std::numbers::pi / 16);
    }
  }
  const auto rounded = [&](double v) { return step * std::trunc(v / step + (v < 0 ? -1 : 1) / 3.0); };
  GrayImage out(image.width(), image.height());
  for (int top = 0; top < image.height(); top += 8) {
    for (int left = 0; left < image.width(); left += 8) {
      Block pixels = Block::NullaryExpr(
          [&](Eigen::Index y, Eigen::Index x) { return static_cast<double>(image.row(top + y)[left + x]); });
      const Block kept = (cosine * pixels * cosine.transpose()).unaryExpr(rounded);
      pixels = cosine.transpose() * kept * cosine;
      for (int y = 0; y < 8; ++y) {
        for (int x = 0; x < 8; ++x) out.row(top + y)[left + x] = testing_support::to_grey(pixels(y, x));
      }
    }
  }
  return out;
}

// Little of what an encoder leaves of the noise is told.
TEST(Noise, NorIsWhatAnEncoderLeavesOfItLeftAlone) {
  const GrayImage dim = smooth_picture(5, 40);
  const GrayImage first = coded(noisy(dim, 9, 1), 36), second = coded(noisy(dim, 9, 2), 36);
  const Grain grain = grain_of(first.view());
  EXPECT_LT(grain.noise, 0.3 * grain.contrast);
  const double before = likeness(first, second);
  EXPECT_LT(before, 0.65);
  EXPECT_GT(likeness(subdued(coded(noisy(dim, 9, 1), 36)), subdued(coded(noisy(dim, 9, 2), 36))),
            before + 0.2);
}

// However much noise there is, a little more changes the picture little: successive images stay alike.
TEST(Noise, AnImageChangesLittleByALittleMoreOfIt) {
  const GrayImage clean = smooth_picture(20);
  for (double noise = 1; noise < 12; noise *= 1.04) {
    EXPECT_GT(likeness(subdued(noisy(clean, noise)), subdued(noisy(clean, 1.02 * noise))), 0.99) << noise;
  }
}

TEST(Noise, WhatIsDimIsStretched) {
  for (const double mean : {15.0, 70.0, 230.0}) {
    const GrayImage clean = smooth_picture(2, mean), dim = noisy(clean, 1), shown = subdued(noisy(clean, 1));
    const Grain before = grain_of(dim.view()), after = grain_of(shown.view());
    EXPECT_LT(before.contrast, 3.5) << mean;
    EXPECT_GT(after.contrast, 3.5) << mean;  // 2 as it was
    EXPECT_LT(after.noise / after.contrast, 0.3 * before.noise / before.contrast) << mean;
    EXPECT_GT(likeness(shown, clean), 0.9) << mean;  // nothing is cut off
  }
}

}  // namespace
}  // namespace raysfm
