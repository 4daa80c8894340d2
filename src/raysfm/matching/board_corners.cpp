#include "raysfm/matching/board_corners.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <new>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>

namespace raysfm {
namespace {

// OpenCV takes pixels that can be written to, and leaves them alone.
cv::Mat borrowed(const GrayView& image) {
  return {image.height, image.width, CV_8UC1, const_cast<uint8_t*>(image.data),
          static_cast<size_t>(image.stride)};
}

Error failed(const cv::Exception& e) {
  if (e.code == cv::Error::StsNoMem) throw std::bad_alloc();
  return internal_error(fmt::format("corners of a board: {}", e.err));
}

// Corners of a board, row by row.
struct CornerGrid {
  std::vector<cv::Point2f> corners;
  int columns, rows;

  cv::Point2f& at(int column, int row) { return corners[row * columns + column]; }

  // Least distance of neighbours.
  double spacing() {
    double least = std::numeric_limits<double>::infinity();
    for (int row = 0; row < rows; ++row) {
      for (int column = 0; column < columns; ++column) {
        if (column > 0) least = std::min(least, cv::norm(at(column, row) - at(column - 1, row)));
        if (row > 0) least = std::min(least, cv::norm(at(column, row) - at(column, row - 1)));
      }
    }
    return least;
  }

  // From x to y as an image's axes turn.
  void turn_like_image() {
    double turn = 0;
    for (int row = 1; row < rows; ++row) {
      for (int column = 1; column < columns; ++column) {
        const cv::Point2f x = at(column, row - 1) - at(column - 1, row - 1);
        const cv::Point2f y = at(column - 1, row) - at(column - 1, row - 1);
        turn += x.cross(y);
      }
    }
    if (turn >= 0) return;
    for (int row = 0; row < rows; ++row) {
      std::reverse(corners.begin() + row * columns, corners.begin() + (row + 1) * columns);
    }
  }

  // The first square is dark.
  void begin_with_dark(const cv::Mat& image) {
    if ((columns + rows) % 2 == 0) return;  // turned half round it would look the same
    double contrast = 0;                    // of the squares like the first to the others
    for (int row = 1; row < rows; ++row) {
      for (int column = 1; column < columns; ++column) {
        const cv::Point2f middle =
            0.25f * (at(column, row) + at(column - 1, row) + at(column, row - 1) + at(column - 1, row - 1));
        const int x = std::clamp(static_cast<int>(std::lround(middle.x)), 0, image.cols - 1);
        const int y = std::clamp(static_cast<int>(std::lround(middle.y)), 0, image.rows - 1);
        contrast += ((column + row) % 2 == 0 ? 1 : -1) * double(image.at<uint8_t>(y, x));
      }
    }
    if (contrast > 0) std::reverse(corners.begin(), corners.end());
  }
};

}  // namespace

Result<std::vector<Eigen::Vector2d>> find_board_corners(const GrayView& image, int columns, int rows) try {
  constexpr double kWindow = 0.3;  // half of it, of the distance between corners
  std::vector<Eigen::Vector2d> pixels;
  if (image.empty()) return pixels;
  const cv::Mat picture = borrowed(image);
  CornerGrid grid{{}, columns, rows};
  // The older of OpenCV's two detectors: it bears strong distortion better, and does not make up boards of a
  // size that is not there.
  const int flags = cv::CALIB_CB_ADAPTIVE_THRESH | cv::CALIB_CB_NORMALIZE_IMAGE;
  if (!cv::findChessboardCorners(picture, {columns, rows}, grid.corners, flags)) return pixels;
  if (static_cast<int>(grid.corners.size()) != columns * rows) return pixels;
  grid.turn_like_image();
  grid.begin_with_dark(picture);
  const int half = static_cast<int>(std::clamp(kWindow * grid.spacing(), 2.0, 8.0));
  cv::cornerSubPix(picture, grid.corners, {half, half}, {-1, -1},
                   cv::TermCriteria(cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 100, 1e-4));
  for (const cv::Point2f& p : grid.corners) pixels.emplace_back(p.x, p.y);
  return pixels;
} catch (const cv::Exception& e) {
  return failed(e);
}

Result<std::array<int, 2>> guess_board_size(const GrayView& image) try {
  constexpr int kLeast = 3;
  std::array<int, 2> size = {0, 0};
  if (image.empty()) return size;
  std::vector<cv::Point2f> corners;
  cv::Mat squares;  // one number for each corner
  if (cv::findChessboardCornersSB(borrowed(image), {kLeast, kLeast}, corners, cv::CALIB_CB_LARGER, squares)) {
    size = {std::max(squares.cols, squares.rows), std::min(squares.cols, squares.rows)};
  }
  return size;
} catch (const cv::Exception& e) {
  return failed(e);
}

}  // namespace raysfm
