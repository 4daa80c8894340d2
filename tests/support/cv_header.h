#pragma once

#include <opencv2/core.hpp>

#include "raysfm/image/image.h"

namespace raysfm::testing_support {

// The same pixels for OpenCV, not copied.
inline cv::Mat header(GrayImage& image) {
  return cv::Mat(image.height(), image.width(), CV_8UC1, image.row(0), image.view().stride);
}

}  // namespace raysfm::testing_support
