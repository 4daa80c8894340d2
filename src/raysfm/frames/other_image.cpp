#include "raysfm/frames/other_image.h"

#include <algorithm>
#include <cstring>
#include <exception>
#include <opencv2/core.hpp>
#include <opencv2/core/utils/logger.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "raysfm/core/memory.h"

namespace raysfm {
namespace {

Image<uint8_t> copied(const cv::Mat& mat) {
  const int values = mat.cols * mat.channels();
  Image<uint8_t> image(values, mat.rows);
  for (int y = 0; y < mat.rows; ++y) std::memcpy(image.row(y), mat.ptr(y), values);
  return image;
}

// OpenCV does not say why it has no pixels.
Error failure(size_t file_bytes) {
  constexpr size_t kPacking = 16, kMostAsked = size_t{1} << 28;
  if (!memory_left(std::min(kPacking * file_bytes, kMostAsked))) {
    return internal_error("not enough memory to decode it");
  }
  return bad_input("the image is damaged and cannot be decoded");
}

DecodedImage converted(cv::Mat mat) {
  if (mat.depth() == CV_16U) mat.convertTo(mat, CV_8U, 1.0 / 257);
  if (mat.channels() == 2) cv::extractChannel(mat, mat, 0);
  DecodedImage image;
  if (mat.channels() == 1) {
    image.gray = copied(mat);
    return image;
  }
  cv::cvtColor(mat, mat, mat.channels() == 4 ? cv::COLOR_BGRA2RGB : cv::COLOR_BGR2RGB);
  image.colors.rgb = copied(mat);
  image.gray = gray_of(image.colors);
  return image;
}

}  // namespace

Result<DecodedImage> decode_other(const std::string& bytes) {
  try {
    const cv::Mat raw(1, static_cast<int>(bytes.size()), CV_8U, const_cast<char*>(bytes.data()));
    const cv::Mat mat = cv::imdecode(raw, cv::IMREAD_UNCHANGED);
    if (mat.empty()) return failure(bytes.size());
    if (mat.depth() != CV_8U && mat.depth() != CV_16U) {
      return bad_input("pixels of another type; allowed: 8 or 16 bits");
    }
    if (auto fits = check_image_size(mat.cols, mat.rows); !fits) return fits.error();
    return converted(mat);
  } catch (const cv::Exception& e) {  // headers that make no sense, and no room for the pixels
    if (e.code == cv::Error::StsNoMem) return internal_error("not enough memory to decode it");
    return failure(bytes.size());
  }
}

void silence_opencv() {
  cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT);
}

}  // namespace raysfm
