#include "raysfm/plots/plot.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <string>
#include <vector>

#include "raysfm/eval/alignment.h"
#include "raysfm/files/atomic_file.h"
#include "raysfm/plots/plot_axes.h"

namespace raysfm {
namespace {

const cv::Scalar kTruth(150, 120, 90);        // blue-grey
const cv::Scalar kDifference(200, 190, 250);  // pale red

constexpr int kWidth = 1200;
constexpr int kLeft = 95;
constexpr int kRight = 35;
constexpr int kViewTop = 112;
constexpr int kErrorHeight = 220;
constexpr int kGap = 95;
constexpr int kBottom = 75;

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
