#include "raysfm/plots/camera_plot.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <opencv2/imgproc.hpp>
#include <string>
#include <vector>

#include "raysfm/camera/observed_ray.h"
#include "raysfm/frames/image_writer.h"

namespace raysfm {
namespace {

const cv::Scalar kTextInk(60, 60, 60);
const cv::Scalar kPanelFrame(170, 170, 170);
const cv::Scalar kFaintGrid(222, 222, 222);
const cv::Scalar kBlind(205, 205, 205);
const cv::Scalar kUAxis(60, 60, 215);   // the image's u axis, red
const cv::Scalar kVAxis(205, 110, 40);  // its v axis, blue
const cv::Scalar kView(150, 120, 90);

constexpr int kPanel = 400;  // longer side
constexpr int kMargin = 40;
constexpr int kTitle = 58;
constexpr int kRowHeight = kPanel + kTitle + 50;
constexpr int kSheetWidth = 3 * kPanel + 4 * kMargin;
constexpr double kDegrees = 180 / std::numbers::pi;

void write_text(cv::Mat& picture, const std::string& text, cv::Point at, double size = 0.45,
                const cv::Scalar& colour = kTextInk) {
  cv::putText(picture, text, at, cv::FONT_HERSHEY_SIMPLEX, size, colour, 1, cv::LINE_AA);
}

cv::Point rounded(const Eigen::Vector2d& p) {
  return {static_cast<int>(std::lround(p.x())), static_cast<int>(std::lround(p.y()))};
}

// A picture of the camera's image, `scale` picture pixels for one of its own.
struct ImagePanel {
  cv::Rect area;
  double scale;

  ImagePanel(const Camera& camera, cv::Point corner)
      : scale(static_cast<double>(kPanel) / std::max(camera.width, camera.height)) {
    area = {corner.x, corner.y, std::max(1, static_cast<int>(camera.width * scale)),
            std::max(1, static_cast<int>(camera.height * scale))};
  }
  Eigen::Vector2d pixel(int column, int row) const {
    return {(column + 0.5) / scale - 0.5, (row + 0.5) / scale - 0.5};
  }
  cv::Point at(const Eigen::Vector2d& pixel) const {
    return area.tl() + rounded((pixel.array() + 0.5).matrix() * scale);
  }
};

// Values over the panel, NaN where there is no ray, as colours between their ends.
void paint(cv::Mat& picture, const ImagePanel& panel, const cv::Mat1f& values, double low, double high) {
  cv::Mat1b levels(values.size(), 0);
  for (int i = 0; i < values.rows; ++i) {
    for (int j = 0; j < values.cols; ++j) {
      if (std::isnan(values(i, j))) continue;
      const double part = high > low ? (values(i, j) - low) / (high - low) : 0.5;
      levels(i, j) = static_cast<uint8_t>(std::clamp(40 + 215 * part, 40.0, 255.0));
    }
  }
  cv::Mat colours;
  cv::applyColorMap(levels, colours, cv::COLORMAP_VIRIDIS);
  colours.setTo(kBlind, levels == 0);
  colours.copyTo(picture(panel.area));
  cv::rectangle(picture, panel.area, kPanelFrame);
}

cv::Mat1f angles(const Camera& camera, const ImagePanel& panel) {
  cv::Mat1f values(panel.area.size(), std::numeric_limits<float>::quiet_NaN());
  for (int i = 0; i < values.rows; ++i) {
    for (int j = 0; j < values.cols; ++j) {
      Ray ray;
      if (!camera.ray(panel.pixel(j, i), &ray)) continue;
      values(i, j) =
          static_cast<float>(std::atan2(ray.direction.head<2>().norm(), ray.direction.z()) * kDegrees);
    }
  }
  return values;
}

cv::Mat1f densities(const Camera& camera, const ImagePanel& panel) {
  cv::Mat1f values(panel.area.size(), std::numeric_limits<float>::quiet_NaN());
  for (int i = 0; i < values.rows; ++i) {
    for (int j = 0; j < values.cols; ++j) {
      Eigen::Matrix<double, 3, 2> by_pixel;
      if (!ray_jacobian(camera, panel.pixel(j, i), &by_pixel)) continue;
      const double solid = by_pixel.col(0).cross(by_pixel.col(1)).norm();
      values(i, j) = static_cast<float>(1 / (kDegrees * std::sqrt(solid)));
    }
  }
  return values;
}

// Darkens the pixels between which a multiple of ten degrees lies.
void draw_isolines(cv::Mat& picture, const ImagePanel& panel, const cv::Mat1f& values) {
  const auto band = [&](int i, int j) { return std::floor(values(i, j) / 10); };
  for (int i = 0; i + 1 < values.rows; ++i) {
    for (int j = 0; j + 1 < values.cols; ++j) {
      if (std::isnan(values(i, j) + values(i + 1, j) + values(i, j + 1))) continue;
      const bool line = band(i, j) != band(i + 1, j) || band(i, j) != band(i, j + 1);
      if (line) picture.at<cv::Vec3b>(panel.area.y + i, panel.area.x + j) = {255, 255, 255};
    }
  }
}

void draw_arrows(cv::Mat& picture, const Camera& camera, const ImagePanel& panel) {
  constexpr int kStep = 40;
  for (int i = kStep / 2; i < panel.area.height; i += kStep) {
    for (int j = kStep / 2; j < panel.area.width; j += kStep) {
      Ray ray;
      if (!camera.ray(panel.pixel(j, i), &ray)) continue;
      const Eigen::Vector2d sideways = ray.direction.head<2>();
      const cv::Point from = panel.area.tl() + cv::Point(j, i);
      cv::arrowedLine(picture, from, from + rounded(16 * sideways), cv::Scalar(255, 255, 255), 1, cv::LINE_AA,
                      0, 0.35);
    }
  }
}

void draw_range(cv::Mat& picture, const ImagePanel& panel, const cv::Mat1f& values, const std::string& unit,
                double* low, double* high) {
  *low = std::numeric_limits<double>::infinity();
  *high = -*low;
  for (const float value : values) {
    if (std::isnan(value)) continue;
    *low = std::min<double>(*low, value);
    *high = std::max<double>(*high, value);
  }
  const std::string text =
      *high < *low ? "no rays" : fmt::format("{:.4g} (dark) to {:.4g} (bright) {}", *low, *high, unit);
  write_text(picture, text, {panel.area.x, panel.area.y + panel.area.height + 18}, 0.42);
}

// The field of view: angle from the axis as radius, the direction of (x, y) as direction.
class FieldPanel {
 public:
  FieldPanel(cv::Mat& picture, cv::Point corner, double reach_deg)
      : picture_(picture), area_(corner.x, corner.y, kPanel, kPanel) {
    step_ = reach_deg > 60 ? 30 : reach_deg > 20 ? 10 : 5;
    reach_ = std::max(step_, std::ceil(reach_deg / step_) * step_);
    for (double r = step_; r <= reach_ + 1e-9; r += step_) {
      cv::circle(picture_, at(0, 0, 0), radius(r), std::abs(r - 90) < 1 ? kPanelFrame : kFaintGrid, 1,
                 cv::LINE_AA);
      write_text(picture_, fmt::format("{:.0f}", r), at(r, 0.5 * std::numbers::pi, 2), 0.36, kPanelFrame);
    }
    cv::line(picture_, at(reach_, 0, 0), at(reach_, std::numbers::pi, 0), kFaintGrid);
    cv::line(picture_, at(reach_, -0.5 * std::numbers::pi, 0), at(reach_, 0.5 * std::numbers::pi, 0),
             kFaintGrid);
  }

  // The rays of the pixels from one to another as a curve.
  void draw_line(const Camera& camera, const Eigen::Vector2d& from, const Eigen::Vector2d& to,
                 const cv::Scalar& colour, int thickness) {
    constexpr int kPoints = 200;
    cv::Point last;
    bool have_last = false;
    for (int i = 0; i <= kPoints; ++i) {
      Ray ray;
      if (!camera.ray(from + (to - from) * (static_cast<double>(i) / kPoints), &ray)) {
        have_last = false;
        continue;
      }
      const Eigen::Vector3d& d = ray.direction;
      const double angle = std::atan2(d.head<2>().norm(), d.z()) * kDegrees;
      const cv::Point point = at(angle, std::atan2(d.y(), d.x()), 0);
      // Across the point behind the camera the curve jumps: no line there.
      if (have_last && cv::norm(point - last) < kPanel / 4.0) {
        cv::line(picture_, last, point, colour, thickness, cv::LINE_AA);
      }
      last = point;
      have_last = true;
    }
  }

 private:
  int radius(double angle_deg) const { return static_cast<int>(angle_deg / reach_ * (0.5 * kPanel - 4)); }
  cv::Point at(double angle_deg, double azimuth, int shift) const {
    const cv::Point centre(area_.x + kPanel / 2, area_.y + kPanel / 2);
    const double r = angle_deg / reach_ * (0.5 * kPanel - 4);
    return centre + rounded({r * std::cos(azimuth), r * std::sin(azimuth)}) + cv::Point(shift, -shift);
  }

  cv::Mat& picture_;
  cv::Rect area_;
  double step_, reach_;
};

void draw_field(cv::Mat& picture, const Camera& camera, cv::Point corner, double reach_deg) {
  constexpr int kLines = 8;
  FieldPanel panel(picture, corner, reach_deg);
  const double w = camera.width - 1, h = camera.height - 1;
  for (int i = 0; i <= kLines; ++i) {
    const double s = static_cast<double>(i) / kLines;
    const bool edge = i == 0 || i == kLines;
    panel.draw_line(camera, {s * w, 0}, {s * w, h}, kView, edge ? 2 : 1);
    panel.draw_line(camera, {0, s * h}, {w, s * h}, kView, edge ? 2 : 1);
  }
  panel.draw_line(camera, {0.5 * w, 0.5 * h}, {w, 0.5 * h}, kUAxis, 2);
  panel.draw_line(camera, {0.5 * w, 0.5 * h}, {0.5 * w, h}, kVAxis, 2);
}

void draw_camera(cv::Mat& picture, const Camera& camera, int top) {
  write_text(
      picture,
      fmt::format("{}: {}, {} x {}", camera.name, model_name(camera.model), camera.width, camera.height),
      {kMargin, top + 22}, 0.6);
  const auto corner = [&](int column) {
    return cv::Point(kMargin + column * (kPanel + kMargin), top + kTitle);
  };
  const char* titles[] = {"angle from the z axis, lines every 10 deg", "pixels per degree",
                          "field of view; red: image right, blue: down"};
  for (int i = 0; i < 3; ++i) write_text(picture, titles[i], corner(i) - cv::Point(0, 10));

  const ImagePanel left(camera, corner(0)), middle(camera, corner(1));
  const cv::Mat1f angle = angles(camera, left), density = densities(camera, middle);
  double low, high, least, most;
  draw_range(picture, left, angle, "deg", &low, &high);
  paint(picture, left, angle, low, high);
  draw_isolines(picture, left, angle);
  draw_arrows(picture, camera, left);
  draw_range(picture, middle, density, "px/deg", &least, &most);
  paint(picture, middle, density, least, most);
  if (high >= low) draw_field(picture, camera, corner(2), high);
}

// The rig in one of its planes: `right` and `up` are the rig's axes that point there in the picture.
void draw_rig(cv::Mat& picture, const Rig& rig, cv::Point corner, const Eigen::Vector3d& right,
              const Eigen::Vector3d& up, const std::string& title) {
  write_text(picture, title, corner - cv::Point(0, 10));
  cv::rectangle(picture, cv::Rect(corner, cv::Size(kPanel, kPanel)), kPanelFrame);
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();
  for (const Camera& camera : rig.cameras) {
    centre += camera.rig_from_cam.translation / static_cast<double>(rig.cameras.size());
  }
  double reach = 1e-9;
  for (const Camera& camera : rig.cameras) {
    reach = std::max(reach, (camera.rig_from_cam.translation - centre).norm());
  }
  const auto at = [&](const Eigen::Vector3d& point) {
    const Eigen::Vector3d d = (point - centre) / reach * (0.3 * kPanel);
    return corner + cv::Point(kPanel / 2, kPanel / 2) + rounded({d.dot(right), -d.dot(up)});
  };
  for (const Camera& camera : rig.cameras) {
    const Eigen::Vector3d place = camera.rig_from_cam.translation;
    const double w = camera.width - 1, h = camera.height - 1;
    for (const Eigen::Vector2d& pixel :
         {Eigen::Vector2d(0.5 * w, 0.5 * h), Eigen::Vector2d(0, 0.5 * h), Eigen::Vector2d(w, 0.5 * h),
          Eigen::Vector2d(0.5 * w, 0), Eigen::Vector2d(0.5 * w, h)}) {
      Ray ray;
      if (camera.width == 0 || !camera.ray(pixel, &ray)) continue;
      const bool middle = pixel.x() == 0.5 * w && pixel.y() == 0.5 * h;
      const Eigen::Vector3d end =
          place + camera.rig_from_cam.rotation * ray.direction * reach * (middle ? 0.6 : 0.35);
      cv::line(picture, at(place), at(end), middle ? kVAxis : kView, middle ? 2 : 1, cv::LINE_AA);
    }
    cv::circle(picture, at(place), 4, kUAxis, cv::FILLED, cv::LINE_AA);
    write_text(picture, camera.name, at(place) + cv::Point(6, -6), 0.4);
  }
  write_text(picture, fmt::format("{:.3g} from the middle to the farthest camera", reach),
             corner + cv::Point(0, kPanel + 18), 0.42);
}

}  // namespace

Result<void> plot_cameras(const Rig& rig, const std::filesystem::path& path) {
  std::vector<const Camera*> shown;
  for (const Camera& camera : rig.cameras) {
    if (camera.width > 0) shown.push_back(&camera);
  }
  if (shown.empty()) {
    return bad_input("resolution: missing; allowed: a camera whose file says the size of the image");
  }
  constexpr size_t kMostRows = 16;
  if (shown.size() > kMostRows) shown.resize(kMostRows);
  const int rows = static_cast<int>(shown.size()) + (rig.cameras.size() > 1 ? 1 : 0);
  cv::Mat picture(rows * kRowHeight, kSheetWidth, CV_8UC3, cv::Scalar::all(255));
  int top = 0;
  for (const Camera* camera : shown) {
    draw_camera(picture, *camera, top);
    top += kRowHeight;
  }
  if (rig.cameras.size() > 1) {
    write_text(picture, fmt::format("the rig, {} cameras", rig.cameras.size()), {kMargin, top + 22}, 0.6);
    const cv::Point corner(kMargin, top + kTitle);
    draw_rig(picture, rig, corner, Eigen::Vector3d::UnitX(), Eigen::Vector3d::UnitZ(),
             "from above: x right, z up in the picture");
    draw_rig(picture, rig, corner + cv::Point(kPanel + kMargin, 0), Eigen::Vector3d::UnitZ(),
             -Eigen::Vector3d::UnitY(), "from the side: z right, y down in the picture");
  }
  return write_color_png(path, ImageView<const uint8_t>{picture.data, 3 * picture.cols, picture.rows,
                                                        static_cast<ptrdiff_t>(picture.step)});
}

}  // namespace raysfm
