#include "raysfm/plots/lens_plot.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "raysfm/files/atomic_file.h"
#include "raysfm/plots/plot_axes.h"

namespace raysfm {
namespace {

constexpr int kLensWidth = 1200, kLensHeight = 480;
constexpr int kLensLeft = 95, kLensRight = 35, kLensTop = 90, kLensBottom = 75;
constexpr double kLeastRange = 0.02;  // of the focal length, so that noise does not fill the picture

// Times from the first, focal lengths, and how far the band reaches to each side; 0 where that is unknown.
Eigen::Matrix3Xd numbers_of(std::span<const LensOfFrame> lenses) {
  Eigen::Matrix3Xd numbers(3, lenses.size());
  for (size_t i = 0; i < lenses.size(); ++i) {
    const double sigma = lenses[i].sigma[0];
    numbers.col(i) << lenses[i].timestamp - lenses[0].timestamp, lenses[i].value[0],
        std::isfinite(sigma) ? 2 * sigma : 0;
  }
  return numbers;
}

Axes axes_of(const Eigen::Matrix3Xd& numbers) {
  const double low = (numbers.row(1) - numbers.row(2)).minCoeff();
  const double high = (numbers.row(1) + numbers.row(2)).maxCoeff();
  const double middle = numbers.row(1).mean();
  // A band that is wider than the focal length itself says nothing more.
  Range y{std::max(low, 0.0), std::min(high, 2 * numbers.row(1).maxCoeff())};
  y = grown(y, std::max(1.1 * y.size(), kLeastRange * middle));
  return {cv::Rect(kLensLeft, kLensTop, kLensWidth - kLensLeft - kLensRight,
                   kLensHeight - kLensTop - kLensBottom),
          {0, std::max(numbers(0, numbers.cols() - 1), 1e-9)},
          y};
}

void draw_band(cv::Mat& picture, const Axes& axes, const Eigen::Matrix3Xd& numbers) {
  const auto at = [&](Eigen::Index i, int side) {
    const double y = std::clamp(numbers(1, i) + side * numbers(2, i), axes.y.low, axes.y.high);
    return fixed_point(axes.pixel(numbers(0, i), y));
  };
  std::vector<cv::Point> outline;
  for (Eigen::Index i = 0; i < numbers.cols(); ++i) outline.push_back(at(i, 1));
  for (Eigen::Index i = numbers.cols(); i-- > 0;) outline.push_back(at(i, -1));
  cv::fillPoly(picture, std::vector<std::vector<cv::Point>>{outline}, kFill, cv::LINE_AA, kShift);
}

}  // namespace

Result<void> plot_lens(std::span<const LensOfFrame> lenses, const std::filesystem::path& path) {
  const Eigen::Matrix3Xd numbers = numbers_of(lenses);
  const Axes axes = axes_of(numbers);
  cv::Mat picture(kLensHeight, kLensWidth, CV_8UC3, cv::Scalar(255, 255, 255));
  draw_text(picture, "focal length fx, with two standard deviations to both sides", {kLensLeft, 36},
            Anchor::kLeft, 0.75);
  draw_band(picture, axes, numbers);
  draw_axes(picture, axes, tick_step(axes.x, 10), tick_step(axes.y, 6), "seconds since the first pose",
            "pixels");
  draw_path(picture, axes, numbers.topRows<2>(), kEstimate, 2);
  std::vector<uchar> png;
  if (!cv::imencode(".png", picture, png)) return internal_error("the plot could not be encoded as PNG");
  return write_file(path, {reinterpret_cast<const char*>(png.data()), png.size()});
}

}  // namespace raysfm
