#include "raysfm/plots/board_plot.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "raysfm/files/atomic_file.h"
#include "raysfm/plots/plot_axes.h"

namespace raysfm {
namespace {

constexpr int kImageSide = 520, kBoardMargin = 40, kBoardTitle = 70;
constexpr int kMostCameras = 16;
constexpr double kArrow = 0.02;  // of the image's larger side: the arrow of an error as large as the rms

// The images of one camera: where it stands in the picture, and how large.
struct BoardPanels {
  const Camera& camera;
  int top;

  double scale() const { return double(kImageSide) / std::max(camera.width, camera.height); }
  int height() const { return static_cast<int>(camera.height * scale()); }
  cv::Point corner(int panel) const {
    return {kBoardMargin + panel * (kImageSide + kBoardMargin), top + kBoardTitle};
  }
  cv::Point2d at(int panel, const Eigen::Vector2d& pixel) const {
    return cv::Point2d(corner(panel)) + scale() * cv::Point2d(pixel.x() + 0.5, pixel.y() + 0.5);
  }
  int bottom() const { return top + kBoardTitle + height() + kBoardMargin; }
};

// Colours that tell views apart.
cv::Scalar colour_of_view(int view, int views) {
  cv::Mat3b pixel(1, 1, cv::Vec3b(static_cast<uint8_t>(180.0 * view / std::max(1, views)), 200, 200));
  cv::cvtColor(pixel, pixel, cv::COLOR_HSV2BGR);
  return {double(pixel(0, 0)[0]), double(pixel(0, 0)[1]), double(pixel(0, 0)[2])};
}

void draw_boards(cv::Mat& picture, const BoardCalibration& calibration, int c, const BoardPanels& panels) {
  const BoardProblem& problem = calibration.problem;
  const double rms = calibration.camera_rms_px[c];
  const double enlarged = kArrow * std::max(panels.camera.width, panels.camera.height) / std::max(rms, 1e-9);
  draw_text(picture,
            fmt::format("{}: {}, {} x {}, rms {:.3g} px", panels.camera.name, model_name(panels.camera.model),
                        panels.camera.width, panels.camera.height, rms),
            {kBoardMargin, panels.top + 28}, Anchor::kLeft, 0.6);
  draw_text(picture, "corners of the board, one colour for each view", panels.corner(0) - cv::Point(0, 10),
            Anchor::kLeft);
  draw_text(picture, fmt::format("errors, {:.3g} times enlarged", enlarged),
            panels.corner(1) - cv::Point(0, 10), Anchor::kLeft);
  for (int panel = 0; panel < 2; ++panel) {
    cv::rectangle(picture, cv::Rect(panels.corner(panel), cv::Size(kImageSide, panels.height())), kFrame);
  }
  const int views = static_cast<int>(problem.rig_from_board.size());
  for (const BoardObservation& o : problem.observations) {
    Eigen::Vector2d residual;
    if (o.camera != c || !board_residual(problem, o, &residual)) continue;
    const cv::Scalar colour = colour_of_view(o.view, views);
    cv::circle(picture, fixed_point(panels.at(0, o.pixel)), 3 << kShift, colour, cv::FILLED, cv::LINE_AA,
               kShift);
    draw_line(picture, panels.at(1, o.pixel), panels.at(1, o.pixel + enlarged * residual), colour, 1);
  }
}

}  // namespace

Result<void> plot_boards(const BoardCalibration& calibration, const std::filesystem::path& path) {
  std::vector<BoardPanels> rows;
  int top = 0;
  for (const Camera& camera : calibration.problem.rig.cameras) {
    if (rows.size() == kMostCameras) break;
    rows.push_back({camera, top});
    top = rows.back().bottom();
  }
  cv::Mat picture(top, 2 * kImageSide + 3 * kBoardMargin, CV_8UC3, cv::Scalar::all(255));
  for (size_t c = 0; c < rows.size(); ++c) draw_boards(picture, calibration, static_cast<int>(c), rows[c]);
  std::vector<uchar> png;
  if (!cv::imencode(".png", picture, png)) return internal_error("the plot could not be encoded as PNG");
  return write_file(path, {reinterpret_cast<const char*>(png.data()), png.size()});
}

}  // namespace raysfm
