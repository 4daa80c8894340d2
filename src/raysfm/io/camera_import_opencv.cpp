#include <fmt/format.h>

#include <algorithm>

#include "raysfm/io/camera_import.h"

namespace raysfm {
namespace {

CameraModel read_model(const ConfigField& matrix, const ConfigField& distortion) {
  const std::vector<double> k = matrix.numbers(9);
  const bool upper = k[3] == 0 && k[6] == 0 && k[7] == 0 && k[8] == 1;
  if (!upper || k[1] != 0) matrix.report("a 3 x 3 matrix fx 0 cx, 0 fy cy, 0 0 1");
  std::vector<double> numbers = {k[0], k[4], k[2], k[5]};
  if (distortion.exists()) {
    std::vector<double> d = distortion.numbers();
    // OpenCV's thin prism and tilt coefficients, twelve or fourteen in all, are usually zero.
    while (d.size() > 8 && d.size() <= 14 && d.back() == 0) d.pop_back();
    if (d.size() > 8 || (d.size() > 5 && d.size() < 8) || (d.size() > 0 && d.size() < 4)) {
      distortion.report(
          "0, 4, 5 or 8 coefficients: k1, k2, p1, p2[, k3[, k4, k5, k6]]; "
          "thin prism and tilt must be zero");
    }
    numbers.insert(numbers.end(), d.begin(), d.end());
  }
  if (matrix.problem().any()) return Pinhole{};
  const CameraModel model = perspective_model(numbers);
  check_intrinsics(model, matrix);
  return model;
}

void read_size(const ConfigField& root, Camera* camera) {
  const ConfigField width = root.any_of({"image_width", "image_Width", "imageWidth", "width"});
  const ConfigField height = root.any_of({"image_height", "image_Height", "imageHeight", "height"});
  const ConfigField both = root.any_of({"image_size", "imageSize", "img_size", "size", "resolution"});
  if (width.exists() || height.exists()) {
    camera->width = width.integer(1, kMaxImageSide);
    camera->height = height.integer(1, kMaxImageSide);
  } else if (both.exists()) {
    const std::vector<double> sides = both.numbers(2);
    const auto side = [&](double v) { return v >= 1 && v <= kMaxImageSide && v == static_cast<int>(v); };
    if (!side(sides[0]) || !side(sides[1])) return both.report("[width, height] in pixels");
    camera->width = static_cast<int>(sides[0]);
    camera->height = static_cast<int>(sides[1]);
  }
}

void refuse_other_models(const ConfigField& root) {
  const std::string allowed = "no such field (supported models: " + supported_models() + ")";
  const ConfigField fisheye = root.at("fisheye_model");
  if (fisheye.exists() && fisheye.text() != "0") fisheye.report(allowed);
  for (const char* key : {"xi", "xi1", "xi2"}) {
    if (root.at(key).exists()) root.at(key).report(allowed);
  }
  const ConfigField model = root.at("distortion_model");
  if (model.exists() && model.text() != "plumb_bob" && model.text() != "rational_polynomial") {
    model.report("plumb_bob, rational_polynomial (supported models: " + supported_models() + ")");
  }
}

Rigid3 read_second_from_first(const ConfigField& root) {
  const std::vector<double> r = root.at("R").numbers();
  Eigen::Matrix3d matrix = Eigen::Matrix3d::Zero();
  if (r.size() == 9) matrix = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(r.data());
  const std::optional<Eigen::Quaterniond> rotation = nearest_rotation(matrix);
  if (!rotation) root.at("R").report("a 3 x 3 rotation matrix");
  const std::vector<double> t = root.at("T").numbers(3);
  if (!rotation) return {};
  return {*rotation, Eigen::Vector3d(t[0], t[1], t[2])};
}

}  // namespace

Rig import_opencv(const ConfigField& root, std::string* note) {
  refuse_other_models(root);
  const auto first = root.any_of({"camera_matrix", "cameraMatrix", "Camera_Matrix", "K", "M", "M1", "K1",
                                  "cameraMatrix1", "camera_matrix_1", "left_camera_matrix"});
  const auto first_d =
      root.any_of({"distortion_coefficients", "dist_coeffs", "distCoeffs", "distortion_coeffs",
                   "Distortion_Coefficients", "D", "D1", "distCoeffs1", "dist_coeffs_1"});
  const auto second = root.any_of({"M2", "K2", "cameraMatrix2", "camera_matrix_2", "right_camera_matrix"});
  const auto second_d = root.any_of({"D2", "distCoeffs2", "dist_coeffs_2"});
  Rig rig;
  Camera camera;
  camera.name = second.exists() ? "left" : "camera";
  camera.model = read_model(first, first_d);
  read_size(root, &camera);
  rig.cameras.push_back(camera);
  if (second.exists() && root.at("R").exists() && root.at("T").exists()) {
    camera.name = "right";
    camera.stream = 1;
    camera.model = read_model(second, second_d);
    camera.rig_from_cam = read_second_from_first(root).inverse();
    rig.cameras.push_back(camera);
  } else if (second.exists()) {
    *note = fmt::format("{} left out: the file has no R and T that say where the second camera is",
                        second.name());
  }
  return rig;
}

}  // namespace raysfm
