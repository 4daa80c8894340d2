#include "raysfm/io/plot.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <string>
#include <vector>

#include "raysfm/eval/alignment.h"
#include "raysfm/io/atomic_file.h"

namespace raysfm {
namespace {

const cv::Scalar kInk(60, 60, 60);
const cv::Scalar kGrid(232, 232, 232);
const cv::Scalar kFrame(170, 170, 170);
const cv::Scalar kTruth(150, 120, 90);        // blue-grey
const cv::Scalar kEstimate(30, 110, 235);     // orange
const cv::Scalar kDifference(200, 190, 250);  // pale red
const cv::Scalar kFill(225, 236, 253);        // pale orange

constexpr int kWidth = 1200;
constexpr int kLeft = 95;
constexpr int kRight = 35;
constexpr int kViewTop = 112;
constexpr int kErrorHeight = 220;
constexpr int kGap = 95;
constexpr int kBottom = 75;
constexpr int kShift = 4;  // fractional bits of drawing coordinates
constexpr int kFont = cv::FONT_HERSHEY_SIMPLEX;

struct Range {
  double low = 0;
  double high = 1;
  double size() const { return high - low; }
};

Range range_of(const Eigen::RowVectorXd& values) {
  return {values.minCoeff(), values.maxCoeff()};
}

Range grown(Range range, double to_size) {
  const double margin = 0.5 * std::max(0.0, to_size - range.size());
  return {range.low - margin, range.high + margin};
}

// A rectangle of the picture and the numbers that its sides stand for.
struct Axes {
  cv::Rect area;
  Range x, y;

  cv::Point2d pixel(double at_x, double at_y) const {
    return {area.x + (at_x - x.low) / x.size() * area.width,
            area.y + area.height - (at_y - y.low) / y.size() * area.height};
  }
};

cv::Point fixed_point(cv::Point2d p) {
  constexpr double kOne = 1 << kShift;
  return {static_cast<int>(std::lround(p.x * kOne)), static_cast<int>(std::lround(p.y * kOne))};
}

void draw_line(cv::Mat& picture, cv::Point2d a, cv::Point2d b, const cv::Scalar& colour, int thickness) {
  cv::line(picture, fixed_point(a), fixed_point(b), colour, thickness, cv::LINE_AA, kShift);
}

enum class Anchor { kLeft, kCentre, kRight };

void draw_text(cv::Mat& picture, const std::string& text, cv::Point at, Anchor anchor, double size = 0.5,
               const cv::Scalar& colour = kInk) {
  const int width = cv::getTextSize(text, kFont, size, 1, nullptr).width;
  if (anchor == Anchor::kCentre) at.x -= width / 2;
  if (anchor == Anchor::kRight) at.x -= width;
  cv::putText(picture, text, at, kFont, size, colour, 1, cv::LINE_AA);
}

// Distance of ticks: 1, 2 or 5 times a power of ten, about `count` of them in the range.
double tick_step(const Range& range, int count) {
  const double wanted = range.size() / count;
  const double power = std::pow(10.0, std::floor(std::log10(wanted)));
  for (const double factor : {1.0, 2.0, 5.0}) {
    if (factor * power >= wanted) return factor * power;
  }
  return 10 * power;
}

std::vector<double> ticks(const Range& range, double step) {
  std::vector<double> values;
  for (double i = std::ceil(range.low / step); i * step <= range.high; ++i) values.push_back(i * step + 0.0);
  return values;
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

void draw_legend(cv::Mat& picture, const cv::Rect& area) {
  const std::pair<const char*, cv::Scalar> entries[] = {
      {"truth", kTruth}, {"estimate, aligned", kEstimate}, {"difference", kDifference}};
  const cv::Rect box(area.x + area.width - 205, area.y + 12, 193, 78);
  cv::rectangle(picture, box, cv::Scalar(255, 255, 255), cv::FILLED);
  cv::rectangle(picture, box, kFrame);
  int v = box.y + 18;
  for (const auto& [name, colour] : entries) {
    cv::line(picture, {box.x + 10, v}, {box.x + 38, v}, colour, 3, cv::LINE_AA);
    draw_text(picture, name, {box.x + 48, v + 5}, Anchor::kLeft, 0.45);
    v += 22;
  }
}

// Paths in the horizontal plane, from the true position at the first match; the truth is the stretch that the
// matches span.
struct TopView {
  Eigen::Matrix2Xd truth;
  Eigen::Matrix2Xd estimate;
  Eigen::Matrix4Xd differences;  // estimated and true position of each match
};

TopView top_view(const Trajectory& estimate, const Trajectory& truth, const Evaluation& e) {
  const int first = e.matches.front().truth;
  const int last = e.matches.back().truth;
  const Eigen::Vector3d& start = truth.world_from_cam[first].translation;
  const auto in_plane = [&](const Rigid3& pose) -> Eigen::Vector2d {
    return e.plane_from_world * (pose.translation - start);
  };
  TopView view;
  view.truth.resize(2, last - first + 1);
  for (int i = first; i <= last; ++i) view.truth.col(i - first) = in_plane(truth.world_from_cam[i]);
  view.estimate.resize(2, estimate.size());
  for (int i = 0; i < estimate.size(); ++i) {
    view.estimate.col(i) = in_plane(transform_pose(e.truth_from_estimate, estimate.world_from_cam[i]));
  }
  view.differences.resize(4, e.matches.size());
  for (size_t i = 0; i < e.matches.size(); ++i) {
    view.differences.col(i) << view.estimate.col(e.matches[i].estimate),
        view.truth.col(e.matches[i].truth - first);
  }
  return view;
}

// Equal scale on both axes; the height of the area follows the extent of the path.
Axes top_view_axes(const TopView& view) {
  Eigen::Matrix2Xd all(2, view.truth.cols() + view.estimate.cols());
  all << view.truth, view.estimate;
  Range x = range_of(all.row(0));
  Range y = range_of(all.row(1));
  const double longest = std::max({x.size(), y.size(), 1e-9 * all.cwiseAbs().maxCoeff(), 1e-9});
  x = grown(x, x.size() + 0.08 * longest);
  y = grown(y, y.size() + 0.08 * longest);

  const int width = kWidth - kLeft - kRight;
  const int height = static_cast<int>(std::clamp(width * y.size() / x.size(), 330.0, 800.0));
  const double units_per_pixel = std::max(x.size() / width, y.size() / height);
  return {cv::Rect(kLeft, kViewTop, width, height), grown(x, units_per_pixel * width),
          grown(y, units_per_pixel * height)};
}

void draw_top_view(cv::Mat& picture, const Axes& axes, const TopView& view) {
  const double step = tick_step(axes.x.size() > axes.y.size() ? axes.x : axes.y, 10);
  draw_axes(picture, axes, step, step, "metres from the start, along the longest extent of the path",
            "metres across, seen from above");
  for (Eigen::Index i = 0; i < view.differences.cols(); ++i) {
    const Eigen::Vector4d d = view.differences.col(i);
    draw_line(picture, axes.pixel(d[0], d[1]), axes.pixel(d[2], d[3]), kDifference, 1);
  }
  draw_path(picture, axes, view.truth, kTruth, 4);
  draw_path(picture, axes, view.estimate, kEstimate, 1);
  for (const auto& position : view.estimate.colwise()) {
    const cv::Point2d at = axes.pixel(position[0], position[1]);
    cv::circle(picture, fixed_point(at), 5 << (kShift - 1), kEstimate, cv::FILLED, cv::LINE_AA, kShift);
  }
  const cv::Point2d start = axes.pixel(view.truth(0, 0), view.truth(1, 0));
  cv::circle(picture, fixed_point(start), 6 << kShift, kInk, 2, cv::LINE_AA, kShift);
  draw_text(picture, "start", cv::Point(static_cast<int>(start.x) + 10, static_cast<int>(start.y) - 10),
            Anchor::kLeft, 0.45);
  draw_legend(picture, axes.area);
}

void draw_errors(cv::Mat& picture, const cv::Rect& area, const Trajectory& truth, const Evaluation& e) {
  Eigen::Matrix2Xd errors(2, e.matches.size());
  const double start = truth.timestamps[e.matches.front().truth];
  for (size_t i = 0; i < e.matches.size(); ++i) {
    errors.col(i) << truth.timestamps[e.matches[i].truth] - start, e.position_errors[i];
  }
  const Axes axes{area, {0, errors(0, errors.cols() - 1)}, {0, std::max(1.08 * e.ate.max, 1e-9)}};

  std::vector<cv::Point> outline = {fixed_point(axes.pixel(0, 0))};
  for (const auto& error : errors.colwise()) outline.push_back(fixed_point(axes.pixel(error[0], error[1])));
  outline.push_back(fixed_point(axes.pixel(axes.x.high, 0)));
  cv::fillPoly(picture, std::vector<std::vector<cv::Point>>{outline}, kFill, cv::LINE_AA, kShift);
  draw_axes(picture, axes, tick_step(axes.x, 10), tick_step(axes.y, 4), "seconds since the first match",
            "position error, metres");
  draw_path(picture, axes, errors, kEstimate, 1);
  draw_line(picture, axes.pixel(0, e.ate.mean), axes.pixel(axes.x.high, e.ate.mean), kInk, 1);
  draw_text(picture, fmt::format("mean {:.3g} (line), max {:.3g}", e.ate.mean, e.ate.max),
            {area.x + area.width, area.y - 10}, Anchor::kRight);
}

}  // namespace

Result<void> plot_evaluation(const Trajectory& estimate, const Trajectory& truth,
                             const Evaluation& evaluation, const std::filesystem::path& path) {
  const TopView view = top_view(estimate, truth, evaluation);
  const Axes axes = top_view_axes(view);
  const cv::Rect errors(kLeft, axes.area.y + axes.area.height + kGap, axes.area.width, kErrorHeight);
  cv::Mat picture(errors.y + errors.height + kBottom, kWidth, CV_8UC3, cv::Scalar(255, 255, 255));

  draw_text(picture,
            fmt::format("mean error {:.3g} m = {:.2g} % of {:.4g} m", evaluation.ate.mean,
                        evaluation.percent_of_path(), evaluation.length),
            {kLeft, 36}, Anchor::kLeft, 0.75);
  draw_text(picture,
            fmt::format("rmse {:.3g} m, max {:.3g} m, {} poses matched ({:.1f} % of the truth)",
                        evaluation.ate.rmse, evaluation.ate.max, evaluation.matches.size(),
                        100 * evaluation.coverage),
            {kLeft, 60}, Anchor::kLeft, 0.5);
  draw_top_view(picture, axes, view);
  draw_errors(picture, errors, truth, evaluation);

  std::vector<uchar> png;
  if (!cv::imencode(".png", picture, png)) return internal_error("the plot could not be encoded as PNG");
  return write_file(path, {reinterpret_cast<const char*>(png.data()), png.size()});
}

}  // namespace raysfm
