#include "raysfm/image/canvas.h"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/imgproc.hpp>

#include "support/texture.h"

namespace raysfm {
namespace {

using testing_support::random_image;

cv::Mat mat_of(GrayImage& image) {
  return cv::Mat(image.height(), image.width(), CV_8U, image.row(0), image.view().stride);
}

// The level is `across` times x and `down` times y.
GrayImage ramp(int width, int height, double across, double down) {
  GrayImage image(width, height);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x)
      image.row(y)[x] = static_cast<uint8_t>(std::lround(across * x + down * y));
  }
  return image;
}

TEST(Canvas, IsTheWarpOfOpenCvWithItsBorderGoingOn) {
  for (const auto& [scale, width, height] :
       {std::tuple{1.0, 97, 64}, {1.37, 160, 101}, {0.7, 97, 64}, {2.0, 120, 90}}) {
    GrayImage image = random_image(81, 60, 1);
    const CanvasPlace place{scale, width, height};
    GrayImage canvas = on_canvas(image.view(), place);
    ASSERT_EQ(canvas.width(), width);
    ASSERT_EQ(canvas.height(), height);
    const cv::Matx23d onto(scale, 0, (width - 1) / 2.0 - scale * 40, 0, scale,
                           (height - 1) / 2.0 - scale * 29.5);
    cv::Mat expected;
    cv::warpAffine(mat_of(image), expected, onto, {width, height}, cv::INTER_LINEAR, cv::BORDER_REPLICATE);
    // OpenCV rounds places to a 32nd of a pixel.
    EXPECT_LE(cv::norm(mat_of(canvas), expected, cv::NORM_INF), 8) << scale;
    EXPECT_LT(cv::norm(mat_of(canvas), expected, cv::NORM_L1) / (width * height), 1.2) << scale;
  }
}

TEST(Canvas, PixelsAreWhereThePlaceSays) {
  const GrayImage image = ramp(80, 60, 2, 1);
  for (const double scale : {0.22, 0.6, 1.0, 1.7}) {
    const CanvasPlace place{scale, 70, 50};
    const GrayImage canvas = on_canvas(image.view(), place);
    for (int y = 0; y < 50; ++y) {
      for (int x = 0; x < 70; ++x) {
        const double u = place.back(x, 80, 70), v = place.back(y, 60, 50);
        EXPECT_NEAR(place.onto(u, 80, 70), x, 1e-9);
        // Where blocks are averaged, the border is as wide as they are.
        if (u < 4 || v < 4 || u > 75 || v > 55) continue;
        EXPECT_NEAR(canvas.row(y)[x], 2 * u + v, 1) << scale << ' ' << x << ' ' << y;
      }
    }
  }
}

TEST(Canvas, AShrunkImageIsAveraged) {
  const GrayImage image = random_image(400, 300, 2);
  const GrayImage canvas = on_canvas(image.view(), {0.1, 40, 30});
  double sum = 0, squares = 0;
  for (int y = 0; y < 30; ++y) {
    for (int x = 0; x < 40; ++x) sum += canvas.row(y)[x], squares += std::pow(canvas.row(y)[x], 2);
  }
  const double deviation = std::sqrt(squares / 1200 - std::pow(sum / 1200, 2));
  EXPECT_LT(deviation, 74 / 4.0);  // of white noise of 74 levels, in blocks of four by four and more
}

TEST(Canvas, ColoursAreThoseOfThePixelsThere) {
  ColorPlanes colors;
  colors.rgb.resize(3 * 40, 30);
  for (int y = 0; y < 30; ++y) {
    for (int x = 0; x < 40; ++x) {
      const bool left = x < 20;
      uint8_t* rgb = colors.rgb.row(y) + ptrdiff_t{3} * x;
      rgb[0] = left ? 200 : 40, rgb[1] = 90, rgb[2] = left ? 30 : 180;
    }
  }
  const GrayImage gray = gray_of(colors);
  const CanvasPlace place{1.5, 60, 45};
  const GrayImage canvas = on_canvas(gray.view(), place);
  const ColorPlanes placed = on_canvas(colors, gray.view(), place);
  for (const auto& [x, red, blue] : {std::tuple{10, 200, 30}, {50, 40, 180}}) {
    const auto rgb = placed.at(x, 20, canvas.row(20)[x]);
    EXPECT_NEAR(rgb[0], red, 3);
    EXPECT_NEAR(rgb[1], 90, 3);
    EXPECT_NEAR(rgb[2], blue, 3);
  }
  EXPECT_TRUE(on_canvas(ColorPlanes{}, gray.view(), place).empty());
}

}  // namespace
}  // namespace raysfm
