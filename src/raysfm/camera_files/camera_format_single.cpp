// Formats of one camera, or a pair: OpenCV, OCamCalib, generic models.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <Eigen/QR>
#include <cmath>

#include "raysfm/camera_files/camera_format.h"
#include "raysfm/camera_files/camera_table.h"

namespace raysfm {
namespace {

std::string opencv_matrix(const std::string& name, int rows, int columns, const std::vector<double>& data) {
  std::string numbers;
  for (size_t i = 0; i < data.size(); ++i) {
    // FileStorage takes a number without a point for an integer.
    std::string word = fmt::format("{}", data[i]);
    if (word.find_first_of(".en") == std::string::npos) word += ".";
    numbers += (i ? ", " : "") + word;
  }
  return fmt::format("{}: !!opencv-matrix\n   rows: {}\n   cols: {}\n   dt: d\n   data: [ {} ]\n", name, rows,
                     columns, numbers);
}

// Kinds of OpenCV's models; both cameras of a pair have to be of one.
enum class OpencvKind { kPerspective, kFisheye, kOmnidir };

OpencvKind kind_of(const CameraModel& model) {
  if (std::holds_alternative<KannalaBrandt>(model)) return OpencvKind::kFisheye;
  return std::holds_alternative<Unified>(model) ? OpencvKind::kOmnidir : OpencvKind::kPerspective;
}

// K, D and xi of a camera; `number` is "", "1" or "2".
std::string opencv_camera(const CameraModel& model, const std::string& number) {
  std::vector<double> p;
  std::visit(
      [&]<typename Model>(const Model& m) {
        if constexpr (ParametricModel<Model>) {
          const auto all = m.parameters();
          p.assign(all.begin(), all.end());
        }
      },
      model);
  const bool pair = !number.empty();
  std::string text =
      opencv_matrix(pair ? "M" + number : "camera_matrix", 3, 3, {p[0], 0, p[2], 0, p[1], p[3], 0, 0, 1});
  p.erase(p.begin(), p.begin() + 4);
  if (kind_of(model) == OpencvKind::kOmnidir) {
    text += fmt::format("xi{}: {:#}\n", number, p.front());
    p.erase(p.begin());
  }
  if (kind_of(model) == OpencvKind::kPerspective && p.size() < 5) p.resize(5, 0);
  return text +
         opencv_matrix(pair ? "D" + number : "distortion_coefficients", 1, static_cast<int>(p.size()), p);
}

}  // namespace

Result<std::vector<CameraFileText>> format_opencv(const Rig& rig) {
  const Camera& first = rig.cameras.front();
  if (rig.cameras.size() > 2) {
    return bad_input(fmt::format("{} cameras; allowed: one or two in OpenCV's format", rig.cameras.size()));
  }
  std::string text = "%YAML:1.0\n---\n";
  text += fmt::format("image_width: {}\nimage_height: {}\n", first.width, first.height);
  if (kind_of(first.model) == OpencvKind::kFisheye) text += "fisheye_model: 1\n";
  if (rig.cameras.size() == 1) {
    return std::vector<CameraFileText>{{"calibration.yml", text + opencv_camera(first.model, "")}};
  }
  const Camera& second = rig.cameras.back();
  if (kind_of(first.model) != kind_of(second.model) || first.width != second.width ||
      first.height != second.height) {
    return bad_input(fmt::format("{} and {}: other models or sizes; allowed: the same in OpenCV's format",
                                 first.name, second.name));
  }
  const Rigid3 second_from_first = second.rig_from_cam.inverse() * first.rig_from_cam;
  const Eigen::Matrix3d r = second_from_first.rotation.toRotationMatrix();
  const Eigen::Vector3d& t = second_from_first.translation;
  text += opencv_camera(first.model, "1") + opencv_camera(second.model, "2");
  text += opencv_matrix("R", 3, 3,
                        {r(0, 0), r(0, 1), r(0, 2), r(1, 0), r(1, 1), r(1, 2), r(2, 0), r(2, 1), r(2, 2)});
  text += opencv_matrix("T", 3, 1, {t.x(), t.y(), t.z()});
  return std::vector<CameraFileText>{{"calibration.yml", text}};
}

namespace {

// The inverse polynomial that OCamCalib's world2cam wants: rho as a polynomial of atan(z / r) in its axes, z
// away from the view; fitted up to the corner of the image.
std::vector<double> inverse_polynomial(const OCam& m, int width, int height) {
  constexpr int kCoefficients = 15;
  constexpr int kSamples = 400;
  double corner = 0;
  for (const double u : {0.0, width - 1.0}) {
    for (const double v : {0.0, height - 1.0}) corner = std::max(corner, std::hypot(u - m.cx, v - m.cy));
  }
  const double reach = std::min(1.02 * corner, 0.999 * m.max_radius);
  Eigen::MatrixXd powers(kSamples, kCoefficients);
  Eigen::VectorXd radius(kSamples);
  for (int i = 0; i < kSamples; ++i) {
    const double rho = reach * (i + 0.5) / kSamples;
    double z = 0;
    for (int k = OCam::kMaxCoefficients - 1; k >= 0; --k) z = z * rho + m.a[k];
    const double theta = std::atan2(-z, rho);
    for (int k = 0; k < kCoefficients; ++k) powers(i, k) = std::pow(theta, k);
    radius(i) = rho;
  }
  const Eigen::VectorXd solved = powers.colPivHouseholderQr().solve(radius);
  return {solved.begin(), solved.end()};
}

}  // namespace

namespace {

// One file for each camera: "calib_results.txt", or "calib_results_0.txt" and so on.
template <typename Format>
Result<std::vector<CameraFileText>> one_file_each(const Rig& rig, const std::string& stem,
                                                  const std::string& ending, Format format) {
  std::vector<CameraFileText> files;
  for (size_t i = 0; i < rig.cameras.size(); ++i) {
    const Result<std::string> text = format(rig.cameras[i]);
    if (!text) return text.error();
    const std::string number = rig.cameras.size() > 1 ? fmt::format("_{}", i) : "";
    files.push_back({stem + number + ending, *text});
  }
  return files;
}

Result<std::string> ocamcalib_text(const Camera& camera) {
  const OCam& m = std::get<OCam>(camera.model);
  std::vector<double> polynomial;
  for (const double a : m.a) polynomial.push_back(a == 0 ? 0.0 : -a);
  while (polynomial.size() > 1 && polynomial.back() == 0) polynomial.pop_back();
  const std::vector<double> inverse = inverse_polynomial(m, camera.width, camera.height);
  return fmt::format(
      "#polynomial coefficients for the DIRECT mapping function (ocam_model.ss in MATLAB)\n\n{} {}\n\n"
      "#polynomial coefficients for the inverse mapping function (ocam_model.invpol in MATLAB)\n\n{} {}\n\n"
      "#center: \"row\" and \"column\", starting from 0 (C convention)\n\n{} {}\n\n"
      "#affine parameters \"c\", \"d\", \"e\"\n\n{} {} {}\n\n#image size: \"height\" and \"width\"\n\n{} "
      "{}\n",
      polynomial.size(), fmt::join(polynomial, " "), inverse.size(), fmt::join(inverse, " "), m.cy, m.cx, m.c,
      m.d, m.e, camera.height, camera.width);
}

}  // namespace

Result<std::vector<CameraFileText>> format_ocamcalib(const Rig& rig) {
  return one_file_each(rig, "calib_results", ".txt", ocamcalib_text);
}

namespace {

std::string grid_text(const std::string& name, const std::vector<Eigen::Vector3d>& points) {
  std::string text = name + " : [";
  for (size_t i = 0; i < points.size(); ++i) {
    text += fmt::format("{}{}, {}, {}", i ? ", " : "", points[i].x(), points[i].y(), points[i].z());
  }
  return text + "]\n";
}

Result<std::string> generic_text(const Camera& camera) {
  const RayGridData* grid = table_of(camera.model);
  if (!grid) return bad_input(fmt::format("{}: an empty ray-table; allowed: one with rays", camera.name));
  for (const Eigen::Vector3d& direction : grid->directions) {
    if (direction.allFinite()) continue;
    return bad_input(fmt::format(
        "{}: a ray-table with holes; allowed: a full one in the format of generic models", camera.name));
  }
  const bool central = grid->points.empty();
  std::string text = fmt::format(
      "type : {}\nwidth : {}\nheight : {}\ncalibration_min_x : {}\ncalibration_min_y : {}\n"
      "calibration_max_x : {}\ncalibration_max_y : {}\ngrid_width : {}\ngrid_height : {}\n",
      central ? "CentralGenericModel" : "NoncentralGenericModel", camera.width, camera.height, grid->min_x,
      grid->min_y, grid->max_x, grid->max_y, grid->grid_width, grid->grid_height);
  if (!central) text += grid_text("point_grid", grid->points);
  return text + grid_text(central ? "grid" : "direction_grid", grid->directions);
}

}  // namespace

Result<std::vector<CameraFileText>> format_generic(const Rig& rig) {
  return one_file_each(rig, "intrinsics", ".yaml", generic_text);
}

}  // namespace raysfm
