#include "raysfm/plots/plot_axes.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

namespace raysfm {
namespace {

constexpr int kFont = cv::FONT_HERSHEY_SIMPLEX;

std::vector<double> ticks(const Range& range, double step) {
  std::vector<double> values;
  for (double i = std::ceil(range.low / step); i * step <= range.high; ++i) values.push_back(i * step + 0.0);
  return values;
}

}  // namespace

Range range_of(const Eigen::RowVectorXd& values) {
  return {values.minCoeff(), values.maxCoeff()};
}

Range grown(Range range, double to_size) {
  const double margin = 0.5 * std::max(0.0, to_size - range.size());
  return {range.low - margin, range.high + margin};
}

cv::Point fixed_point(cv::Point2d p) {
  constexpr double kOne = 1 << kShift;
  return {static_cast<int>(std::lround(p.x * kOne)), static_cast<int>(std::lround(p.y * kOne))};
}

void draw_line(cv::Mat& picture, cv::Point2d a, cv::Point2d b, const cv::Scalar& colour, int thickness) {
  cv::line(picture, fixed_point(a), fixed_point(b), colour, thickness, cv::LINE_AA, kShift);
}

void draw_text(cv::Mat& picture, const std::string& text, cv::Point at, Anchor anchor, double size,
               const cv::Scalar& colour) {
  const int width = cv::getTextSize(text, kFont, size, 1, nullptr).width;
  if (anchor == Anchor::kCentre) at.x -= width / 2;
  if (anchor == Anchor::kRight) at.x -= width;
  cv::putText(picture, text, at, kFont, size, colour, 1, cv::LINE_AA);
}

double tick_step(const Range& range, int count) {
  const double wanted = range.size() / count;
  const double power = std::pow(10.0, std::floor(std::log10(wanted)));
  for (const double factor : {1.0, 2.0, 5.0}) {
    if (factor * power >= wanted) return factor * power;
  }
  return 10 * power;
}

void draw_axes(cv::Mat& picture, const Axes& axes, double step_x, double step_y, const std::string& label_x,
               const std::string& label_y) {
  const int bottom = axes.area.y + axes.area.height;
  const int right = axes.area.x + axes.area.width;
  for (const double x : ticks(axes.x, step_x)) {
    const int u = static_cast<int>(std::lround(axes.pixel(x, axes.y.low).x));
    cv::line(picture, {u, axes.area.y}, {u, bottom}, kGrid);
    draw_text(picture, fmt::format("{:.6g}", x), {u, bottom + 20}, Anchor::kCentre, 0.45);
  }
  for (const double y : ticks(axes.y, step_y)) {
    const int v = static_cast<int>(std::lround(axes.pixel(axes.x.low, y).y));
    cv::line(picture, {axes.area.x, v}, {right, v}, kGrid);
    draw_text(picture, fmt::format("{:.6g}", y), {axes.area.x - 8, v + 5}, Anchor::kRight, 0.45);
  }
  cv::rectangle(picture, axes.area, kFrame);
  draw_text(picture, label_x, {axes.area.x + axes.area.width / 2, bottom + 45}, Anchor::kCentre);
  draw_text(picture, label_y, {axes.area.x, axes.area.y - 10}, Anchor::kLeft);
}

void draw_path(cv::Mat& picture, const Axes& axes, const Eigen::Matrix2Xd& path, const cv::Scalar& colour,
               int thickness) {
  std::vector<cv::Point> points;
  for (Eigen::Index i = 0; i < path.cols(); ++i) {
    points.push_back(fixed_point(axes.pixel(path(0, i), path(1, i))));
  }
  cv::polylines(picture, points, false, colour, thickness, cv::LINE_AA, kShift);
}

}  // namespace raysfm
