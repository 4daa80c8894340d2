#pragma once

#include <filesystem>
#include <opencv2/imgcodecs.hpp>
#include <string>
#include <vector>

#include "raysfm/image/image.h"

namespace raysfm::testing_support {

// A grey image with a pattern that depends on `seed`, for tests that recognise frames by their content.
inline cv::Mat pattern(int width, int height, int seed) {
  cv::Mat image(height, width, CV_8U);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) image.at<uint8_t>(y, x) = static_cast<uint8_t>(3 * x + 5 * y + 17 * seed);
  }
  return image;
}

// Writes numbered images "name-prefix0.png", ... and returns their folder.
inline std::filesystem::path write_images(const std::filesystem::path& folder, int count, int width = 32,
                                          int height = 24) {
  std::filesystem::create_directories(folder);
  for (int i = 0; i < count; ++i) {
    cv::imwrite((folder / (std::to_string(i) + ".png")).string(), pattern(width, height, i));
  }
  return folder;
}

inline bool same_pixels(const GrayImage& image, const cv::Mat& expected) {
  if (image.width() != expected.cols || image.height() != expected.rows) return false;
  for (int y = 0; y < image.height(); ++y) {
    for (int x = 0; x < image.width(); ++x) {
      if (image.row(y)[x] != expected.at<uint8_t>(y, x)) return false;
    }
  }
  return true;
}

}  // namespace raysfm::testing_support
