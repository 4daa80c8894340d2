#include "raysfm/frames/jpeg_writer.h"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/imgcodecs.hpp>

namespace raysfm {
namespace {

TEST(JpegWriter, OpenCvReadsWhatWasWritten) {
  Image<uint8_t> rgb(3 * 65, 47);
  for (int y = 0; y < 47; ++y) {
    for (int x = 0; x < 65; ++x) {
      rgb.row(y)[3 * x] = static_cast<uint8_t>(3 * x + 20);
      rgb.row(y)[3 * x + 1] = static_cast<uint8_t>(4 * y + 10);
      rgb.row(y)[3 * x + 2] = 200;
    }
  }
  Result<std::string> file = encode_jpeg(rgb, 90);
  ASSERT_TRUE(file.ok());
  const cv::Mat bgr =
      cv::imdecode(cv::Mat(1, static_cast<int>(file->size()), CV_8U, file->data()), cv::IMREAD_COLOR);
  ASSERT_EQ(bgr.cols, 65);
  ASSERT_EQ(bgr.rows, 47);
  double sum = 0;
  for (int y = 0; y < 47; ++y) {
    for (int x = 0; x < 65; ++x) {
      for (int c = 0; c < 3; ++c) sum += std::abs(rgb.row(y)[3 * x + c] - bgr.at<cv::Vec3b>(y, x)[2 - c]);
    }
  }
  EXPECT_LT(sum / (3 * 65 * 47), 3);
  EXPECT_GT(file->size(), encode_jpeg(rgb, 20)->size());
}

TEST(JpegWriter, AnEmptyImageIsRefused) {
  EXPECT_FALSE(encode_jpeg({}, 90).ok());
}

}  // namespace
}  // namespace raysfm
