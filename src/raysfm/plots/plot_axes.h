#pragma once

// Drawing of diagrams; for sources of this folder alone, which may see OpenCV.

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

namespace raysfm {

// Colours of all plots: of lines and texts, of what lies behind, and of what is shown.
inline const cv::Scalar kInk(60, 60, 60);
inline const cv::Scalar kGrid(232, 232, 232);
inline const cv::Scalar kFrame(170, 170, 170);
inline const cv::Scalar kEstimate(30, 110, 235);  // orange
inline const cv::Scalar kFill(225, 236, 253);     // pale orange

constexpr int kShift = 4;  // fractional bits of drawing coordinates

// What one side of a plot stands for.
struct Range {
  double low = 0;
  double high = 1;
  double size() const { return high - low; }
};

Range range_of(const Eigen::RowVectorXd& values);
// Widened about its middle to at least `to_size`.
Range grown(Range range, double to_size);

// A rectangle of the picture and the numbers that its sides stand for.
struct Axes {
  cv::Rect area;
  Range x, y;

  cv::Point2d pixel(double at_x, double at_y) const {
    return {area.x + (at_x - x.low) / x.size() * area.width,
            area.y + area.height - (at_y - y.low) / y.size() * area.height};
  }
};

// In steps of 2^-kShift pixels.
cv::Point fixed_point(cv::Point2d p);

// The end of a text that is at its place.
enum class Anchor { kLeft, kCentre, kRight };

// Smoothed lines and texts.
void draw_line(cv::Mat& picture, cv::Point2d a, cv::Point2d b, const cv::Scalar& colour, int thickness);
void draw_text(cv::Mat& picture, const std::string& text, cv::Point at, Anchor anchor, double size = 0.5,
               const cv::Scalar& colour = kInk);
// Distance of ticks: 1, 2 or 5 times a power of ten, about `count` of them in the range.
double tick_step(const Range& range, int count);
void draw_axes(cv::Mat& picture, const Axes& axes, double step_x, double step_y, const std::string& label_x,
               const std::string& label_y);
// Through the columns of `path`, x and y.
void draw_path(cv::Mat& picture, const Axes& axes, const Eigen::Matrix2Xd& path, const cv::Scalar& colour,
               int thickness);

}  // namespace raysfm
