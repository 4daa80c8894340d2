#include "raysfm/image/color_planes.h"

#include <gtest/gtest.h>

#include <opencv2/imgproc.hpp>

namespace raysfm {
namespace {

using Rgb = std::array<uint8_t, 3>;

TEST(ColorPlanes, WithoutColoursGreyIsGrey) {
  EXPECT_TRUE(ColorPlanes().empty());
  EXPECT_EQ(ColorPlanes().at(3, 5, 77), (Rgb{77, 77, 77}));
}

TEST(ColorPlanes, ColoursSideBySideAreTaken) {
  for (const int values : {3, 4}) {
    ColorPlanes colors;
    colors.values_per_pixel = values;
    colors.rgb = Image<uint8_t>(5 * values, 4);
    for (int y = 0; y < 4; ++y) {
      for (int i = 0; i < 5 * values; ++i) colors.rgb.row(y)[i] = static_cast<uint8_t>(50 * y + i);
    }
    const int first = 50 * 2 + 3 * values;
    EXPECT_EQ(colors.at(3, 2, 0), (Rgb{uint8_t(first), uint8_t(first + 1), uint8_t(first + 2)}));
  }
}

// OpenCV's YCrCb is that of JPEG.
TEST(ColorPlanes, ChromaGivesTheColoursThatItWasMadeOf) {
  const cv::Vec3b colours[] = {{200, 90, 30}, {10, 240, 60}, {128, 128, 128}, {255, 255, 0}};
  for (const cv::Vec3b& rgb : colours) {
    cv::Mat pixel(1, 1, CV_8UC3, cv::Scalar(rgb)), y_cr_cb;
    cv::cvtColor(pixel, y_cr_cb, cv::COLOR_RGB2YCrCb);
    const cv::Vec3b y = y_cr_cb.at<cv::Vec3b>(0, 0);
    ColorPlanes colors;
    colors.step_x = 2;
    colors.step_y = 4;
    colors.cb = Image<uint8_t>(3, 3);
    colors.cr = Image<uint8_t>(3, 3);
    for (int r = 0; r < 3; ++r) {
      for (int c = 0; c < 3; ++c) colors.cb.row(r)[c] = colors.cr.row(r)[c] = 128;
    }
    colors.cr.row(1)[2] = y[1];
    colors.cb.row(1)[2] = y[2];
    for (const auto& [at_x, at_y] : {std::pair(4, 4), std::pair(5, 7)}) {
      const Rgb found = colors.at(at_x, at_y, y[0]);
      for (int c = 0; c < 3; ++c) EXPECT_NEAR(found[c], rgb[c], 2);
    }
    EXPECT_EQ(colors.at(3, 4, y[0]), (Rgb{y[0], y[0], y[0]}));
    EXPECT_EQ(colors.at(4, 3, y[0]), (Rgb{y[0], y[0], y[0]}));
  }
}

}  // namespace
}  // namespace raysfm
