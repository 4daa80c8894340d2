#include "raysfm/image/noise.h"

#include <gtest/gtest.h>

#include "support/texture.h"

namespace raysfm {
namespace {

using testing_support::render;
using testing_support::Texture;

// A picture of some contrast, and so much white noise; grey levels.
GrayImage noisy(double contrast, double noise, int width = 640, int height = 480) {
  const Texture texture(3, 12, 200, contrast);
  return render(
      texture, width, height, [](const Eigen::Vector2d& p) -> Eigen::Vector2d { return p; }, 1, 0, noise);
}

TEST(Noise, IsToldAsAPartOfTheContrast) {
  for (const double contrast : {12.0, 40.0}) {
    for (const double noise : {2.0, 5.0}) {
      const double share = noise_share(noisy(contrast, noise).view());
      // The contrast of the upper quintile of blocks of 16 pixels is near that of the texture.
      EXPECT_GT(share, 0.6 * noise / std::hypot(contrast, noise)) << contrast << " " << noise;
      EXPECT_LT(share, 1.7 * noise / std::hypot(contrast, noise)) << contrast << " " << noise;
    }
    EXPECT_LT(noise_share(noisy(contrast, 0.3).view()), 0.06) << contrast;
  }
}

// Half of the image without a picture, as about a fisheye's, is no picture without noise.
TEST(Noise, BordersSayNothing) {
  GrayImage image = noisy(20, 6);
  const double whole = noise_share(image.view());
  for (int y = 0; y < image.height(); ++y) std::fill_n(image.row(y), image.width() * 2 / 5, uint8_t{0});
  EXPECT_NEAR(noise_share(image.view()), whole, 0.2 * whole);
}

TEST(Noise, WhereNothingTellsItThereIsNone) {
  EXPECT_EQ(noise_share(GrayImage(0, 0).view()), 0);
  EXPECT_EQ(noise_share(noisy(20, 6, 17, 400).view()), 0);
  GrayImage flat(640, 480);
  for (int y = 0; y < 480; ++y) std::fill_n(flat.row(y), 640, uint8_t{90});
  EXPECT_EQ(noise_share(flat.view()), 0);
  EXPECT_GT(noise_share(noisy(20, 6, 18, 18).view()), 0);
}

}  // namespace
}  // namespace raysfm
